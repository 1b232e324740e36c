"""One plain function a stage: paths in, paths out. Free of luigi, so each can be called and tested alone."""
