"""Cameras that lie beside a cloud, which tell its up axis and where it was seen from."""
