"""Built-in G-buffers: cloud, camera and light -> rough feature pictures for the network."""
