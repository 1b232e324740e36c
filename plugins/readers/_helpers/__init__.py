"""Helpers of the readers; no plugins."""
