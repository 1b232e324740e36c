"""Camera files beside a cloud, which give its up axis and viewpoint; no plugins."""
