"""Limits of values, and error messages: one line each, with the fix."""
