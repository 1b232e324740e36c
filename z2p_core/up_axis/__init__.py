"""Which axis of a cloud points up: by its shape, its file header, or the convention of its format."""
