"""Places a scan before the camera, and describes what was done to it."""
