"""Scans on disk: which files are scans, which reader takes each, and what of their points is passed on."""
