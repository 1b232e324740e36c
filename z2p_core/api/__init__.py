"""What `z2p_core` offers to Python: `render`, its result `Picture`, `Previewer`, and the types of points they take."""
