"""Data of training and evaluation: random views of meshes, points sampled on them, and ground-truth renders."""
