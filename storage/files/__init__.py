"""File utilities: atomic writes, disk errors, bounded JSON and printable names."""
