"""Logs of motions: read, screened, filtered and prepared for a fit."""
