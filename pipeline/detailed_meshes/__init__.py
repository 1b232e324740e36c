"""Meshes of a million faces and more with fine relief, made by the project itself: what dense clouds are judged by."""
