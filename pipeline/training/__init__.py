"""From renders to weights: shards, batches, augmentation, the training loop and its state."""
