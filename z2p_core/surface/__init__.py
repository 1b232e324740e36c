"""From bare points to a surface: spacing, noise level, normals, and smoothing."""
