"""Colors of a scan's points: by their own colors, by a scalar field or by labels."""
