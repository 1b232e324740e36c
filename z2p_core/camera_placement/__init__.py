"""Cameras in the data's units, as placed clouds see them."""
