"""Built-in baselines: what one could do today instead of z2p."""
