"""`Picture`, the result of `z2p_core.render`: it shows itself in notebooks, saves itself, and has a record."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.api.backend import load_backend
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_core.interfaces import SettingError
from z2p_core.pinhole import PinholeCamera, camera_from_json
from z2p_core.placement.usual_camera import usual_pinhole
from z2p_core.placement.viewpoint import Viewpoint, viewpoint_from_json


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture; or the contact sheet of a batch, whose members are `picture[0]`, `picture[1]`, ..."""

    array: np.ndarray
    """(H, W, 4) uint8, straight sRGB RGBA; for a batch, its pictures in a near-square sheet."""
    record: Mapping[str, Any]
    """All that made it: input, camera, controls, weights, version. It is saved inside the file."""
    notes: tuple[str, ...] = ()
    """What was left out or guessed, in words."""
    parts: tuple[Picture, ...] = field(default=(), repr=False)
    """The pictures of a batch; empty for one picture."""
    passes: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    """What else was asked for, by name: ``picture.passes["depth"]``; of a batch, each picture has its own."""

    @property
    def camera(self) -> Viewpoint | PinholeCamera:
        """Its camera, for `render(others, camera=...)`; for a batch, that of the first picture."""
        pinhole = self[0].record.get("pinhole")
        if pinhole is not None:
            return camera_from_json(pinhole)
        return viewpoint_from_json(self[0].record["camera"])

    @property
    def pinhole(self) -> PinholeCamera:
        """Its camera with K, R and t in the data's units; not of a trimmed picture, nor one with a colour bar."""
        record = self[0].record
        if "pinhole" in record:
            return camera_from_json(record["pinhole"])
        viewpoint, (width, height) = viewpoint_from_json(record["camera"]), record["resolution"]
        elevation = record["controls"].get("elevation", [viewpoint.elevation])[0]
        return usual_pinhole(viewpoint, width, height, elevation)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """The path, once the picture is written there: PNG, WebP, JPEG or TIFF by its suffix, the record inside.

        Raises:
            ValueError: no path, or a suffix of another format.
            OSError: it cannot be written.
        """
        if not isinstance(path, str | os.PathLike):
            raise SettingError(f"expected a path to save the picture to, got {type(path).__name__}; pillow writes to "
                               "others: PIL.Image.fromarray(picture.array).save(...)")
        load_backend().save_image(self.array, self.record, Path(path))
        return Path(path)

    def save_passes(self, path: str | os.PathLike[str], format: str = "npy") -> list[Path]:
        """The files of its passes, once these and their camera are written beside a picture of that path.

        Args:
            path: ``fig.png`` gives ``fig_depth.npy`` and so on, and ``fig_camera.json``.
            format: ``npy``, ``png`` with 16 bits, or ``exr``, which needs the extra of that name.

        Raises:
            SettingError: it has no passes, or the format cannot be written.
            OSError: a file cannot be written.
        """
        if not self.passes:
            raise SettingError("expected a picture with passes, got none; ask for them: render(points, passes='all')")
        return load_backend().save_passes(self.passes, self.pinhole, Path(path), format)

    def on(self, background: str | Sequence[float]) -> Picture:
        """The same picture over a background: a CSS name, #hex or three numbers in [0, 1]; alpha is 255 throughout.

        The pictures of a batch get it too. ``transparent`` changes nothing.
        """
        color = load_backend().parse_background(background)
        if color is None:
            return self
        record, parts = {**self.record, "background": list(color)}, tuple(part.on(color) for part in self.parts)
        return replace(self, array=opaque_over(self.array, color), record=record, parts=parts)

    def __repr__(self) -> str:
        height, width = self.array.shape[:2]
        name = self.record.get("input", {}).get("name") or "an array"
        return f"<Picture {width}x{height} of {f'{len(self)} clouds' if self.parts else name}>"

    def __len__(self) -> int:
        return len(self.parts) or 1

    def __getitem__(self, index: int) -> Picture:
        return (self.parts or (self,))[index]

    def __iter__(self) -> Iterator[Picture]:
        return iter(self.parts or (self,))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.array, dtype=dtype) if copy or dtype is not None else self.array

    def _repr_png_(self) -> bytes:
        """PNG for a notebook."""
        return load_backend().encode_png(self.array, self.record)


def tile_images(pictures: Sequence[np.ndarray], columns: int | None = None) -> np.ndarray:
    """Images (H, W, 4) uint8 in rows, in one near-square image (H', W', 4) uint8, or with so many `columns`.

    Cells have the size of the largest image; smaller ones are centered, and the rest is transparent.
    """
    columns = columns or math.ceil(math.sqrt(len(pictures)))
    height, width = (max(picture.shape[axis] for picture in pictures) for axis in (0, 1))
    rows = -(-len(pictures) // columns)
    tiled = np.zeros((rows * height, columns * width, 4), dtype=np.uint8)
    for index, picture in enumerate(pictures):
        top = index // columns * height + (height - picture.shape[0]) // 2
        left = index % columns * width + (width - picture.shape[1]) // 2
        tiled[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return tiled


def opaque_over(image: np.ndarray, background: tuple[float, float, float]) -> np.ndarray:
    """A straight RGBA image (H, W, 4) uint8 over an sRGB background in [0, 1]; its alpha is 255."""
    rgb = bytes_from_unit(composite(unit_from_bytes(image), background))
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, dtype=np.uint8)])
