"""Training and evaluation data: random views of meshes, their points, and ground-truth renders."""
