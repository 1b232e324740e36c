"""Built-in painters: methods that draw a cloud in screen space, without a mesh, for comparison."""
