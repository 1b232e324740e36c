"""Built-in mesh samplers."""
