"""Keeping a workspace in order: which results are in use, reused, linked, adopted or removed."""
