"""Loads of drives, gears and bearings along a motion."""
