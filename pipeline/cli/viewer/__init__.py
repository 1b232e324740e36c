"""`z2p view`: a page in the browser in which one looks around scans, and takes the picture."""
