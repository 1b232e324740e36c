"""Built-in z-buffers: projected cloud -> picture for the network."""
