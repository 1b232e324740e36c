"""Colour fidelity: the mean colour of the object in a picture against that in the true one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, TRUTH, WEIGHTS
from z2p_renderer.pipeline.evaluation.paper.page.results import Results
from z2p_renderer.pipeline.evaluation.paper.page.tables import Table, values_cell

MIN_OPAQUE_ALPHA = 250
"""Smallest alpha, of 255, of a pixel that counts as the object alone."""
MIN_CHROMA = 10.0
"""Chroma in CIELAB below which a true colour is a grey without a hue."""


@dataclass(frozen=True)
class ColorError:
    """Error of the object's mean colour in CIELAB."""

    lightness: float
    """|L* - true L*|; the whole scale is 100."""
    chroma: float
    """|C* - true C*|."""
    hue: float | None
    """Degrees between the hues; None if the true colour is a grey."""


def color_table(errors: Mapping[str, Sequence[ColorError]]) -> Table:
    """Table with a row per method: mean and spread of its colour errors over all pictures."""
    rows = []
    for name, own in errors.items():
        columns = ([getattr(one, part) for one in own] for part in ("hue", "lightness", "chroma"))
        rows.append((name, *(values_cell([value for value in column if value is not None]) for column in columns)))
    note = (
        "Error of the mean colour of the object's pixels in CIELAB, against Blender's picture; mean ± standard "
        "deviation over the colours and meshes."
    )
    head = ("method", "hue, degrees", "lightness L*", "chroma C*")
    return Table("The colour that comes out", head, tuple(rows), note)


def color_errors(results: Results, folders: Mapping[str, Path], sweep: str) -> dict[str, list[ColorError]]:
    """Method -> error of each of its pictures in a sweep, against the true one of the same mesh, level and view."""
    true = {(row["mesh"], row["level"], row["view"]): row for row in results.rows(sweep, TRUTH)}
    errors: dict[str, list[ColorError]] = {}
    for method in (*results.named(WEIGHTS), *results.named(BASELINE)):
        errors[method] = []
        for row in (row for row in results.rows(sweep, method) if "picture" in row):
            other = true[row["mesh"], row["level"], row["view"]]
            error = color_error(_read_image(folders, sweep, row, method), _read_image(folders, sweep, other, TRUTH))
            errors[method] += [] if error is None else [error]
    return errors


def color_error(picture: np.ndarray, truth: np.ndarray) -> ColorError | None:
    """Error of the mean colour where both pictures (H, W, 4) uint8, straight sRGB, show the object; None if nowhere."""
    both = (picture[..., 3] >= MIN_OPAQUE_ALPHA) & (truth[..., 3] >= MIN_OPAQUE_ALPHA)
    if not both.any():
        return None
    (lightness, a, b), (true_lightness, true_a, true_b) = (
        _lab_from_srgb(one[both][:, :3]).mean(0) for one in (picture, truth)
    )
    chroma, true_chroma = math.hypot(a, b), math.hypot(true_a, true_b)
    turn = math.degrees(math.atan2(b, a) - math.atan2(true_b, true_a))
    hue = abs((turn + 180) % 360 - 180) if true_chroma >= MIN_CHROMA else None
    return ColorError(abs(lightness - true_lightness), abs(chroma - true_chroma), hue)


def _read_image(folders: Mapping[str, Path], sweep: str, row: Mapping[str, str], method: str) -> np.ndarray:
    with Image.open(folders[f"measure/{sweep}/{row['mesh'] or 'shapes'}/{method}"] / row["picture"]) as opened:
        return np.asarray(opened.convert("RGBA"))


def _lab_from_srgb(pixels: np.ndarray) -> np.ndarray:
    """CIELAB (N, 3) float64, white point D65, of sRGB pixels (N, 3) uint8."""
    import torch  # late, as kornia: both are slow to import
    from kornia.color import rgb_to_lab

    planes = torch.from_numpy(pixels.astype(np.float64).T[None, :, :, None] / 255)  # (1, 3, N, 1)
    lab: np.ndarray = rgb_to_lab(planes)[0, :, :, 0].T.numpy()
    return lab
