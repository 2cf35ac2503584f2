"""Motions within limits that determine the parameters well."""
