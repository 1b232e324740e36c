"""Knowledge of file formats: headers, columns and arrays of numbers. No file is opened here."""
