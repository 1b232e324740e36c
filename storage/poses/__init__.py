"""Files of cameras in the data's units: those of z2p itself, of COLMAP and of nerfstudio."""
