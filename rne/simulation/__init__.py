"""Scenes and their motion over time."""
