"""Variants of a training, compared."""
