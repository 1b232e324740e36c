"""Pure heart of z2p: camera, interfaces, network, losses, metrics. Touches no file, imports no luigi, h5py or bpy."""

__version__ = "0.1.0"
