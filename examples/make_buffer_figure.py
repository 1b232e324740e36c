"""Makes the figure of docs/how-it-works.md: the buffers of one cloud, in the order in which they are made.

    python examples/make_buffer_figure.py docs/images/buffers.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from z2p_core import registry
from z2p_core.camera import DEFAULT_ELEVATION, Camera, turn
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_core.interfaces import Value
from z2p_core.placement.viewpoint import frame_points
from z2p_core.scene import SceneDescription
from z2p_core.settings import apply_controls
from z2p_core.shading.channels import GBufferChannel
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.scans.clouds import read_clouds

SCAN = Path(__file__).parents[1] / "samples" / "chair.ply"
AZIMUTH_DEGREES = 35.0
VALUES: dict[str, Value] = {"color": (0.29, 0.53, 0.73), "light": (3.6, 60.0, 40.0), "elevation": (20.0,)}
SIDE = 300
"""Pixels of each panel's side."""
LABEL_HEIGHT = 24
BACKGROUND = (0.93, 0.93, 0.95)
WHITE = (1.0, 1.0, 1.0)


def main(out: Path) -> None:
    """Write the figure, an opaque PNG of two rows of five panels with a label below each."""
    points = read_clouds(SCAN)[0].points
    cloud = frame_points(points, turn(AZIMUTH_DEGREES), DEFAULT_ELEVATION).place(points)
    panels = list(buffer_panels(cloud).items())
    rows = [np.concatenate([labelled(*panel) for panel in panels[first : first + 5]], axis=1) for first in (0, 5)]
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(rows)).quantize(256).save(out, optimize=True)


def buffer_panels(cloud: np.ndarray) -> dict[str, np.ndarray]:
    """Label -> panel (SIDE, SIDE, 3), sRGB in [0, 1], of a placed cloud (N, 3) float32.

    The z-buffer's intensities are shown by their square roots, for most of them are small.
    """
    camera, scene = Camera(SIDE, SIDE, DEFAULT_ELEVATION), SceneDescription()
    apply_controls(VALUES, {name: registry.load("controls", name)() for name in VALUES}, scene)
    zbuffer = registry.load("zbuffers", "splats")().draw(cloud, camera)
    gbuffer = registry.load("gbuffers", "surfels")().draw(cloud, camera, scene)
    coverage, density, depth, right, down, grey, red, green, blue, shadow = (gbuffer[one] for one in GBufferChannel)
    covered = (coverage > 0)[..., None]
    toward = np.sqrt(np.clip(1 - right**2 - down**2, 0, 1))
    normals = np.where(covered, np.stack([right, -down, toward], axis=2) * 0.5 + 0.5, BACKGROUND)
    picture = unit_from_bytes(Renderer("regular").render(cloud, VALUES, SIDE, SIDE))
    return {
        "points": point_panel(cloud, camera),
        "z-buffer, window of 5 pixels": gray_panel(np.sqrt(zbuffer[0])),
        "z-buffer, single pixels": gray_panel(np.sqrt(zbuffer[1])),
        "density": gray_panel(density),
        "depth": gray_panel(depth),
        "normals": normals,
        "grey radiance": np.where(covered, grey[..., None], BACKGROUND),
        "radiance": np.where(covered, np.stack([red, green, blue], axis=2), BACKGROUND),
        "alpha of the floor shadow": gray_panel(1 - shadow),
        "picture on white": composite(picture, WHITE),
    }


def point_panel(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """White panel (H, W, 3) with a dark pixel for each visible or hidden point."""
    panel = np.ones((camera.height, camera.width, 3))
    pixels, _ = camera.project(cloud)
    columns, rows = pixels.astype(int).T
    inside = (columns >= 0) & (rows >= 0) & (columns < camera.width) & (rows < camera.height)
    panel[rows[inside], columns[inside]] = 0.2
    return panel


def gray_panel(channel: np.ndarray) -> np.ndarray:
    """Panel (H, W, 3) of one channel (H, W) in [0, 1]."""
    return np.repeat(np.clip(channel, 0, 1)[..., None], 3, axis=2)


def labelled(label: str, panel: np.ndarray) -> np.ndarray:
    """A panel (SIDE, SIDE, 3) in [0, 1] as bytes (SIDE + LABEL_HEIGHT, SIDE, 3), its label below it, a rim around."""
    image = Image.new("RGB", (SIDE, SIDE + LABEL_HEIGHT), "white")
    image.paste(Image.fromarray(bytes_from_unit(panel.astype(np.float32))), (0, 0))
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, SIDE - 1, SIDE - 1), outline="#889")
    draw.text((SIDE // 2, SIDE + LABEL_HEIGHT // 2), label, fill="black", anchor="mm", font_size=15)
    return np.asarray(image)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
