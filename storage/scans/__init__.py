"""Scans on disk: finds the files, chooses a reader for each, and keeps the points that can be drawn."""
