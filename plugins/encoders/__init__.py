"""Built-in positional encoders."""
