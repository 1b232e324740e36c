"""Built-in controls, one file each: all that z2p knows of a control is in its file."""
