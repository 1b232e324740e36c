"""Built-in z-buffers: images of a projected cloud, which the network reads."""
