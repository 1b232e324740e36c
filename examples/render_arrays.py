"""Pictures of clouds that are already in Python: arrays, tensors, and the clouds of other libraries.

    python examples/render_arrays.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
import trimesh

import z2p_core


def main(folder: Path) -> None:
    """Write the pictures into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    angle, height = np.random.default_rng(0).uniform(size=(2, 4000)) * [[2 * np.pi], [1.0]]
    radius = 0.4 + 0.15 * np.sin(2 * np.pi * height)
    vase = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 1.4 * height])

    # one cloud, one picture
    picture = z2p_core.render(vase, color="teal", light=(3.6, -40, 50), size=320)
    picture.save(folder / "vase.png")  # straight alpha, and the settings inside: `z2p info vase.png`
    assert picture.array.shape == (320, 320, 4)

    # a batch is a sheet, and a sequence of pictures
    batch = torch.from_numpy(np.stack([vase * [1, 1, squeeze] for squeeze in (0.4, 0.7, 1.0)]))
    sheet = z2p_core.render(batch, size=160, color="#d0803a", background="white")
    sheet.save(folder / "sheet.png")
    sheet[1].save(folder / "second.webp")

    # one camera for all of them: true sizes beside each other
    camera = sheet[2].camera
    z2p_core.render(batch, size=160, camera=camera).save(folder / "same_camera.png")

    # clouds of open3d, trimesh, pyvista and laspy go in as they are
    ball = trimesh.creation.icosphere(subdivisions=4)
    z2p_core.render(trimesh.PointCloud(ball.vertices), size=160).save(folder / "trimesh.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("previews"))
