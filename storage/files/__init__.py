"""Files in general: written whole or not at all, with clear errors and printable names."""
