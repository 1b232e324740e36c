"""From a cloud's own coordinates to the unit sphere before the camera: outliers, background, view and frame."""
