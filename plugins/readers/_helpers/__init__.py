"""What several readers share; no plugins."""
