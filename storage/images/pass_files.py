"""Files of passes: NumPy arrays, 16-bit PNG or EXR, and beside them a camera file that says what their numbers mean."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import SettingError
from z2p_core.pinhole import PinholeCamera
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.images.png import encode_png16

PASS_FORMATS = ("npy", "png", "exr")
WHITE_16 = 65535
"""Largest number of a 16-bit PNG."""
EXR_OFFSET_EXTENTS = 1000.0
"""Distance from the origin, in the positions' extent, beyond which float32 numbers of an EXR get an offset."""
MEANINGS = {
    "depth": "distance along the optical axis, in the data's units",
    "normal": "unit normal in the data's axes x, y, z, towards the camera",
    "albedo": "base color red, green, blue, in [0, 1]",
    "alpha": "share of the pixel that the surface covers",
    "position": "coordinates x, y, z of the surface in the data's units",
    "trust": "how well points support the surface, 0 to 1",
}


@dataclass(frozen=True)
class Stored:
    """Numbers as a file holds them: value = stored * scale + offset."""

    numbers: np.ndarray
    scale: float = 1.0
    offset: Sequence[float] | float = 0.0
    empty: str = "NaN"
    """What stands for no surface."""
    encoding: str = "linear"


def check_pass_format(format: str) -> None:
    """
    Raises:
        SettingError: there is no such format, or the library that writes it is not installed.
    """
    if format not in PASS_FORMATS:
        raise SettingError(f"passes: expected the format {', '.join(PASS_FORMATS)}, got {format!r}")
    if format == "exr":
        _import_openexr()


def pass_paths(picture: Path, names: Sequence[str], format: str) -> list[Path]:
    """The files of a picture's passes, and the camera file, the last one."""
    return [*(picture.with_name(f"{picture.stem}_{name}.{format}") for name in names), camera_path(picture)]


def camera_path(picture: Path) -> Path:
    """The file that holds the camera of a picture's passes."""
    return picture.with_name(f"{picture.stem}_camera.json")


def write_passes(
    passes: Mapping[str, np.ndarray], camera: PinholeCamera, picture: Path, format: str = "npy"
) -> list[Path]:
    """The files beside `picture`, once the passes and the camera are written there.

    The camera file is one of `PinholeCamera.to_json`, with what each pass's numbers mean under ``passes``.

    Raises:
        SettingError: EXR is asked for, and OpenEXR is not installed.
        OSError: a file cannot be written.
    """
    described = {}
    for name, values in passes.items():
        stored = _stored(name, values, format)
        path = picture.with_name(f"{picture.stem}_{name}.{format}")
        atomic_write(_encode(stored.numbers, format), path)
        described[name] = {
            "file": path.name, "meaning": MEANINGS[name], "scale": stored.scale, "offset": stored.offset,
            "no_surface": stored.empty, "encoding": stored.encoding,
        }  # fmt: skip
    data = {**camera.to_json(), "pixels": "pixel (column i, row j) covers [i, i+1) x [j, j+1)", "passes": described}
    atomic_write((json.dumps(data, indent=2) + "\n").encode(), camera_path(picture))
    return pass_paths(picture, list(passes), format)


def _stored(name: str, values: np.ndarray, format: str) -> Stored:
    if format == "npy":
        return Stored(values, empty="0" if name in ("alpha", "trust") else "NaN")
    if format == "exr":
        return _stored_float32(name, values)
    if name in ("alpha", "trust"):
        return Stored(np.rint(np.clip(values, 0, 1) * WHITE_16).astype(np.uint16), 1 / WHITE_16, 0.0, "0")
    if name == "albedo":
        encoded = np.nan_to_num(srgb_from_linear(np.clip(values, 0, 1)) * WHITE_16)
        return Stored(np.rint(encoded).astype(np.uint16), 1 / WHITE_16, 0.0, "0", "sRGB")
    low, high = (-1.0, 1.0) if name == "normal" else _limits(values)
    scale = (high - low) / (WHITE_16 - 1) or 1.0
    numbers = np.where(np.isfinite(values), np.rint((values - low) / scale) + 1, 0)
    return Stored(numbers.astype(np.uint16), scale, low - scale, "0")


def _stored_float32(name: str, values: np.ndarray) -> Stored:
    empty = "0" if name in ("alpha", "trust") else "NaN"
    if name != "position" or not np.isfinite(values).any():
        return Stored(values.astype(np.float32), empty=empty)
    low, high = np.nanmin(values, axis=(0, 1)), np.nanmax(values, axis=(0, 1))
    middle = (low + high) / 2
    if np.abs(middle).max() <= EXR_OFFSET_EXTENTS * max(float((high - low).max()), 1e-300):
        return Stored(values.astype(np.float32), empty=empty)
    return Stored((values - middle).astype(np.float32), 1.0, middle.tolist(), empty)


def _limits(values: np.ndarray) -> tuple[float, float]:
    """Least and largest finite value; (0, 0) without any."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)


def _encode(numbers: np.ndarray, format: str) -> bytes:
    if format == "png":
        return encode_png16(numbers)
    if format == "exr":
        return _encode_exr(numbers)
    file = io.BytesIO()
    np.save(file, numbers)
    return file.getvalue()


def _encode_exr(numbers: np.ndarray) -> bytes:
    """An EXR file of float32 numbers (H, W), channel Y, or (H, W, 3), channels R, G, B."""
    import tempfile

    openexr: Any = _import_openexr()
    channels = {"Y": numbers} if numbers.ndim == 2 else {"RGB": np.ascontiguousarray(numbers)}
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    with tempfile.TemporaryDirectory() as folder:  # the library writes to paths only
        path = Path(folder) / "pass.exr"
        openexr.File(header, channels).write(str(path))
        return path.read_bytes()


def _import_openexr() -> Any:
    try:
        import OpenEXR
    except ImportError:
        raise SettingError(
            f"passes: EXR files need OpenEXR ({install_advice('exr')}); npy and png need nothing"
        ) from None
    return OpenEXR
