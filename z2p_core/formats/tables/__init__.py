"""Tables of text: their header lines, what their columns hold, and values that stand for no measurement."""
