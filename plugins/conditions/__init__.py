"""Built-in conditions: pictures of a cloud's own colors."""
