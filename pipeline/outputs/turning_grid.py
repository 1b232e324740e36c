"""Turntables of several clouds side by side, as one film."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from z2p_core.api.picture import tile_images
from z2p_core.interfaces import Value
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RenderedScan
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.outputs.animation import Motion, draw_opening, render_frames
from z2p_renderer.storage.scans.clouds import Scan


def draw_openings(
    clouds: Sequence[tuple[Scan, str]], colors: Sequence[Value | None], renderer: AnyRenderer, look: Look
) -> list[tuple[RenderedScan, Look]]:
    """The opening of each cloud's loop, with its look: the given one, with the cloud's own color where it has one.

    Raises:
        ScanError: a cloud has no extent.
    """
    looks = [look if color is None else replace(look, values={**look.values, "color": color}) for color in colors]
    return [(draw_opening(renderer, scan, suffix, own), own) for (scan, suffix), own in zip(clouds, looks, strict=True)]


def grid_frames(
    clouds: Sequence[tuple[Scan, str]], openings: Sequence[tuple[RenderedScan, Look]], motion: Motion,
    columns: int | None = None,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Frames (H, W, 4) uint8 in which all clouds move together, in rows of so many columns or near-square."""
    loops = [render_frames(opening, scan, look, motion)
             for (scan, _), (opening, look) in zip(clouds, openings, strict=True)]  # fmt: skip
    for pictures in zip(*loops, strict=True):
        yield tile_images(pictures, columns)
