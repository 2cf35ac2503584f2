"""Mutation run: breaks lines of the package one at a time and sees whether the short tests notice."""
