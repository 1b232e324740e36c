"""Ablations: the comparison of a training run's variants."""
