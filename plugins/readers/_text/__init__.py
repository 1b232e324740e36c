"""Parts of the text reader; no plugins."""
