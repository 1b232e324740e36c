"""Built-in point-cloud readers, selected by suffix."""
