"""Parts of PCD files."""
