"""Limits of values, and the words of error messages: one line each, with the fix."""
