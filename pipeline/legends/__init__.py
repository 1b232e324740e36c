"""Color bars of scalar fields and legends of classes, beside a picture or as files of their own."""
