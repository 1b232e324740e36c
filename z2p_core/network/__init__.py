"""The conditioned U-Net and what running it needs."""
