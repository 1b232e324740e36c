"""Which axis of a cloud points up: told by its shape, by its header, or by what is usual for its format."""
