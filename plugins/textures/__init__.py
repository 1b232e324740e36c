"""Built-in textures: colors as functions of the place in space."""
