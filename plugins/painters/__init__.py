"""Built-in painters: what draws a cloud on the screen without a mesh, to compare with."""
