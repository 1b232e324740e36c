"""What the report on the paper measures: its sweeps, their clouds, and the ground truth of each."""
