"""Tables of text: header lines, contents of columns, and no-data values."""
