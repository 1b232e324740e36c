"""Weights on disk: checkpoints with their cards, and the ONNX files made of them."""
