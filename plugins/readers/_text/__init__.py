"""How the text reader finds its way in a file; no plugins."""
