"""Previews of a training every 100 steps: a toy generator learns a ring, and z2p draws its samples for TensorBoard.

    python examples/training_preview.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image

import z2p_core

STEPS = 300
PREVIEW_EVERY = 100


def main(folder: Path) -> None:
    """Train, and write a sheet of four samples every 100 steps into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    generator = torch.nn.Sequential(torch.nn.Linear(8, 64), torch.nn.Tanh(), torch.nn.Linear(64, 3 * 256))
    optimizer = torch.optim.Adam(generator.parameters(), lr=3e-3)
    angle = torch.linspace(0, 2 * torch.pi, 257)[:256]
    ring = torch.stack([angle.cos(), angle.sin(), 0.2 * (3 * angle).sin()], dim=-1)

    preview = z2p_core.Previewer(size=128, most=4, color="#4a87ba")  # loads the weights once; checks its options now
    for step in range(STEPS + 1):
        samples = generator(torch.randn(16, 8)).view(16, 256, 3)
        loss = ((samples - ring) ** 2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % PREVIEW_EVERY == 0:
            image = preview(samples)  # (3, H, W) uint8; never raises, even for samples that are no cloud
            # writer.add_image("samples", image, step)
            Image.fromarray(np.moveaxis(image, 0, -1)).save(folder / f"step_{step:04d}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("previews"))
