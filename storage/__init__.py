"""Every byte on disk: fingerprinted stage outputs, scans and meshes, shards, weights."""
