"""The cases of the report on the paper: parameter sweeps, their clouds and scenes, and their ground truth."""
