"""How a scan comes to stand before the camera, and what the user is told of it."""
