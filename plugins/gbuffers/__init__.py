"""Built-in G-buffers: rough feature images of a cloud under a light, which the network reads."""
