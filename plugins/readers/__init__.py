"""Built-in point-cloud readers, found by suffix."""
