"""Colors of fields: scalars through a colormap between two limits, labels through a palette."""
