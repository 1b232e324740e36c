"""Arrays in files: depth maps, point maps, and arrays that are no clouds."""
