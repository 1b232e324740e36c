"""Ablations: their plan, the task that a user starts, and the task of the final comparison."""
