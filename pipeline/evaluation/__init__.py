"""Evaluation of weights: metrics against ground truth, baselines, ablations, and the report on the paper."""
