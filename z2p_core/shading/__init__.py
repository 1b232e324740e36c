"""Light on surfels and on the floor below them: area light, shadows, indirect light, specular reflection."""
