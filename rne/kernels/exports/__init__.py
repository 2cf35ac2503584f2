"""Exports of a traced program as a function of another package, one file for each."""
