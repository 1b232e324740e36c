"""From a scan to its picture: weights, engine, input buffers, network, and the finished image."""
