"""How good weights are: metrics against ground truth, baselines, ablations, and the paper's evaluation."""
