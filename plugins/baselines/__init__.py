"""Built-in baselines: other ways to draw a point cloud, compared with z2p."""
