"""Arrays that readers meet: depth maps, point maps, and what is no cloud at all."""
