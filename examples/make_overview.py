"""Makes the README's picture: the sample scans as dots, and below them what z2p makes of each.

    python examples/make_overview.py docs/images/overview.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from z2p_core.camera import DEFAULT_ELEVATION, DEPTH_RANGE, Camera, turn
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_core.interfaces import Value
from z2p_core.placement.viewpoint import frame_points
from z2p_renderer.pipeline.inference.weight_selection import load_renderer, select_renderer
from z2p_renderer.storage.scans.clouds import read_clouds

SIDE = 320
WHITE = (1.0, 1.0, 1.0)
LOOKS: dict[str, tuple[float, dict[str, Value]]] = {
    "suzanne.ply": (0.0, {"color": (0.85, 0.45, 0.25), "light": (3.6, -45.0, 50.0)}),
    "amphora.ply": (20.0, {"color": (0.85, 0.65, 0.13), "light": (3.6, 45.0, 45.0), "metallic": (1.0,),
                           "roughness": (0.3,)}),
    "knot.xyz": (0.0, {"color": (0.45, 0.65, 0.4), "light": (3.6, -30.0, 60.0), "elevation": (30.0,)}),
    "chair.ply": (35.0, {"color": (0.29, 0.53, 0.73), "light": (3.6, 60.0, 40.0)}),
}  # fmt: skip
"""Scan -> azimuth in degrees, controls."""


def main(out: Path) -> None:
    """Write the overview, an opaque PNG of two rows."""
    columns = []
    for name, (azimuth, values) in LOOKS.items():
        points = read_clouds(Path(__file__).parents[1] / "samples" / name)[0].points
        cloud = frame_points(points, turn(azimuth), DEFAULT_ELEVATION).place(points)
        camera = Camera(SIDE, SIDE, values.get("elevation", (20.0,))[0])
        renderer, _ = select_renderer(load_renderer("auto", values), cloud)
        picture = unit_from_bytes(renderer.render(cloud, values, 2 * SIDE, 2 * SIDE))
        small = np.asarray(Image.fromarray(bytes_from_unit(composite(picture, WHITE))).resize((SIDE, SIDE)))
        columns.append(np.concatenate([dots(cloud, camera), small]))
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(columns, axis=1)).save(out, optimize=True)


def dots(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """Picture (H, W, 3) uint8 of the bare points, near ones darker."""
    picture = np.full((camera.height, camera.width, 3), 255, dtype=np.uint8)
    pixels, depth = camera.project(cloud)
    for place in np.argsort(-depth):
        column, row = pixels[place].astype(int)
        picture[row : row + 2, column : column + 2] = int(40 + 80 * (depth[place] - DEPTH_RANGE[0]))
    return picture


if __name__ == "__main__":
    main(Path(sys.argv[1]))
