"""Pictures and animations on disk, with the record of what made them inside."""
