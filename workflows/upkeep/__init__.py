"""Maintenance of a workspace: results in use, garbage collection, adoption, links and reuse of renders."""
