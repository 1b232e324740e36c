"""What `z2p_core` offers to Python: `render`, the `Picture` that it returns, `Previewer`, and the point types it accepts."""
