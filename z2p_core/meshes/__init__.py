"""Points sampled on triangle meshes, and noise added to them."""
