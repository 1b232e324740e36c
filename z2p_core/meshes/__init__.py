"""Points sampled on triangle meshes, and synthetic noise."""
