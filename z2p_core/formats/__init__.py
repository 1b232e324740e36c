"""What file formats look like inside: headers, columns and arrays of numbers. No file is opened here."""
