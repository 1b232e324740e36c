"""Films along a path of cameras: a frame of each, of a cloud that stands still under a light bound to the camera."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import AnyCamera, PinholeCamera
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, camera_elevation, render_scan
from z2p_renderer.pipeline.inference.trim import content_box, crop_box
from z2p_renderer.pipeline.placement.place_scan import place_scan
from z2p_renderer.storage.scans.clouds import Scan


def check_path(cameras: Sequence[AnyCamera]) -> None:
    """
    Raises:
        SettingError: there is no path, or pictures differ in size.
    """
    if len(cameras) < 2:
        raise SettingError("cameras: expected a path of at least two for a film, got one; z2p run-inference draws it")
    sizes = sorted({(camera.width, camera.height) for camera in cameras if isinstance(camera, PinholeCamera)})
    if len(sizes) > 1:
        named = ", ".join(f"{width} x {height}" for width, height in sizes[:3])
        raise SettingError(f"cameras: expected pictures of one size for a film, got {named}; leave out those of the "
                           "others")


def path_digest(cameras: Sequence[AnyCamera]) -> str:
    """What tells one path of cameras from another, for records."""
    return hashlib.sha256(json.dumps([camera.to_json() for camera in cameras]).encode()).hexdigest()


def render_path(
    opening: RenderedScan, scan: Scan, suffix: str, look: Look, cameras: Sequence[AnyCamera]
) -> Iterator[np.ndarray]:
    """A frame (H, W, 4) uint8, straight RGBA, as each camera sees the scan of a file with that suffix.

    All frames are drawn with the weights of `opening`. If the network does not know one of the views, none is drawn
    with it: the look would jump. With `look.tight` all are cropped to the union of their visible parts.
    """
    renderer = opening.renderer
    elevation = camera_elevation(renderer, look.values)
    looks = [replace(look.untrimmed, margin=None).taken_by(camera) for camera in cameras]
    reasons = [place_scan(scan, suffix, one.placement_options, *elevation).unfamiliar for one in looks]
    unfamiliar = next(filter(None, reasons), "")
    looks = [replace(one, without_network=unfamiliar) for one in looks]
    frames = (render_scan(renderer, scan, suffix, one).picture for one in looks)
    if not look.tight:
        yield from frames
        return
    drawn = list(frames)
    box = content_box(np.max([frame[..., 3] for frame in drawn], axis=0), look.margin)
    yield from (crop_box(frame, box) for frame in drawn)
