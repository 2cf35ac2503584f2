"""Logs of motions: read, screened, filtered and made ready for a fit."""
