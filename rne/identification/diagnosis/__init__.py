"""Diagnosis of a fit: residuals, their likely causes, and tests of the parameters."""
