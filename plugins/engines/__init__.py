"""Built-in engines: libraries that run the trained network."""
