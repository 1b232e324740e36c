"""What `z2p_core.render` and `z2p_core.animate` call."""
