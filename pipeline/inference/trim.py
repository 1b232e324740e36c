"""Parts of an image: the box around its visible pixels, and images cut to a box or to a share of the frame."""

from __future__ import annotations

import math

import numpy as np

from z2p_renderer.pipeline.inference.look import Crop

Box = tuple[int, int, int, int]
"""First row, row after the last, first column, column after the last; may reach beyond the image."""

MIN_VISIBLE_ALPHA = 8
"""Alpha, of 255, from which on a pixel counts as visible: above the faint veil that some weights leave at borders."""
MAX_STRAY_PIXELS = 2
"""A row or column with at most so many visible pixels counts as empty."""
TRIM_MARGIN = 0.02
"""Default border around a trimmed picture, as a share of the frame's shorter side."""


def trim_to_content(image: np.ndarray, margin: float | None = None) -> np.ndarray:
    """Visible part (H', W', 4) of a straight RGBA image (H, W, 4) uint8; see `content_box`."""
    return crop_box(image, content_box(image[..., 3], margin))


def content_box(alpha: np.ndarray, margin: float | None = None) -> Box:
    """Box around the visible pixels of alpha (H, W) uint8; the whole image if none is visible.

    `margin`, a share of the shorter side, is added on every side, even beyond the image. None adds `TRIM_MARGIN`, but
    never reaches beyond the image.
    """
    height, width = alpha.shape
    visible = alpha >= MIN_VISIBLE_ALPHA
    rows, columns = (np.flatnonzero(visible.sum(axis) > MAX_STRAY_PIXELS) for axis in (1, 0))
    if not (len(rows) and len(columns)):
        return 0, height, 0, width
    border = round((TRIM_MARGIN if margin is None else margin) * min(height, width))
    top, bottom, left, right = rows[0] - border, rows[-1] + border + 1, columns[0] - border, columns[-1] + border + 1
    if margin is None:
        top, bottom, left, right = max(top, 0), min(bottom, height), max(left, 0), min(right, width)
    return int(top), int(bottom), int(left), int(right)


def crop_frame(image: np.ndarray, crop: Crop) -> np.ndarray:
    """The part (H', W', 4) of an image (H, W, 4) that a crop covers; images of one size give parts of one size."""
    return crop_box(image, crop_rows_and_columns(image, crop))


def crop_rows_and_columns(image: np.ndarray, crop: Crop) -> Box:
    """The box that a crop covers in an image (H, W, 4)."""
    (height, width), (left, top, right, bottom) = image.shape[:2], crop
    return math.floor(top * height), math.ceil(bottom * height), math.floor(left * width), math.ceil(right * width)


def crop_box(image: np.ndarray, box: Box) -> np.ndarray:
    """The part (H', W', 4) of an image (H, W, 4) inside a box, padded with zeros where the box reaches beyond it."""
    (height, width), (top, bottom, left, right) = image.shape[:2], box
    inside = image[max(top, 0) : bottom, max(left, 0) : right]
    padding = ((max(-top, 0), max(bottom - height, 0)), (max(-left, 0), max(right - width, 0)), (0, 0))
    return np.pad(inside, padding) if np.any(padding) else inside
