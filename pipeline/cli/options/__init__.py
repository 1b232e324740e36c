"""Options that commands share, and the types that their values are parsed with."""
