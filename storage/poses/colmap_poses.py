"""Cameras of COLMAP models: cameras.txt and images.txt, or cameras.bin and images.bin.

https://colmap.github.io/format.html: quaternions (w, x, y, z) and translations go from the world to the camera, whose
axes are OpenCV's; pixel centers are at 0.5.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from z2p_core.interfaces import SettingError
from z2p_core.pinhole import PinholeCamera, pinhole_camera
from z2p_core.rotations import quaternion_rotations

MODELS = (
    ("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8), ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12), ("FOV", 5), ("SIMPLE_RADIAL_FISHEYE", 4), ("RADIAL_FISHEYE", 5), ("THIN_PRISM_FISHEYE", 12),
)  # fmt: skip
"""Names of the camera models by their number in binary files, and how many parameters each has."""
ONE_FOCAL_LENGTH = frozenset({"SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"})
FISHEYE = frozenset({"OPENCV_FISHEYE", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"})
"""Models whose picture is no pinhole camera's even without distortion."""
SUB_FOLDERS = (".", "0", "sparse", "sparse/0")
"""Where COLMAP puts a model below a folder."""
MAX_NAME_BYTES = 4096
FEATURE_BYTES = 24
MAX_FILE_BYTES = 1 << 30
"""Larger lists of images are not read."""


@dataclass(frozen=True)
class Lens:
    """The intrinsics of a camera."""

    size: tuple[int, int]
    focal: tuple[float, float]
    center: tuple[float, float]
    is_distorted: bool


def is_colmap_model(path: Path) -> bool:
    """Whether a path is a model's folder, or one of its files cameras and images."""
    if path.is_dir():
        return _model_folder(path) is not None
    return path.stem.lower() in ("cameras", "images") and path.suffix.lower() in (".txt", ".bin")


def _model_folder(folder: Path) -> Path | None:
    """The folder of the model in a folder: itself, or the first model of a reconstruction; None without one."""
    candidates = [folder / name for name in SUB_FOLDERS]
    found = [one for one in candidates if any((one / f"cameras{suffix}").is_file() for suffix in (".txt", ".bin"))]
    return found[0] if found else None


def read_colmap_poses(path: Path) -> tuple[list[PinholeCamera], str]:
    """The cameras of a model's images in the order of their names, and what was left out, in words.

    Raises:
        SettingError: a file is missing, damaged or too large, or a camera is no pinhole camera.
        OSError: a file cannot be read.
    """
    folder = (_model_folder(path) or path) if path.is_dir() else path.parent
    suffixes = (path.suffix,) if path.suffix in (".txt", ".bin") and not path.is_dir() else (".bin", ".txt")
    for suffix in suffixes:
        cameras, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
        if not (cameras.is_file() and images.is_file()):
            continue
        if max(cameras.stat().st_size, images.stat().st_size) > MAX_FILE_BYTES:
            raise SettingError(f"expected lists of images of at most {MAX_FILE_BYTES:,} bytes")
        try:
            lenses = dict(_lenses_txt(cameras) if suffix == ".txt" else _lenses_bin(cameras))
            poses = list(_images_txt(images) if suffix == ".txt" else _images_bin(images))
        except (ValueError, struct.error, IndexError, UnicodeDecodeError) as error:
            if isinstance(error, SettingError):
                raise
            raise SettingError(f"expected a COLMAP model, got a damaged one ({error}); export it again") from error
        return _cameras(lenses, poses)
    raise SettingError(f"expected cameras and images side by side ({' or '.join(suffixes)}), got only a part of them")


def _cameras(
    lenses: dict[int, Lens], poses: list[tuple[np.ndarray, np.ndarray, int, str]]
) -> tuple[list[PinholeCamera], str]:
    """The cameras of images (quaternion, translation, camera's number, name), and a note on distortion."""
    cameras = []
    for quaternion, translation, number, name in poses:
        if number not in lenses:
            raise SettingError(f"expected a camera {number} for the image {name!r}, got none in cameras")
        lens = lenses[number]
        length = float(np.linalg.norm(quaternion))
        if not (np.isfinite(quaternion).all() and length > 0):
            raise SettingError(f"expected a quaternion for the image {name!r}, got {quaternion.tolist()}")
        (fx, fy), (cx, cy) = lens.focal, lens.center
        rotation = quaternion_rotations(quaternion[None] / length)[0]
        cameras.append(pinhole_camera([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], rotation, translation, lens.size,
                                      name=name))  # fmt: skip
    distorted = any(lens.is_distorted for lens in lenses.values())
    note = "lens distortion is left out: undistort the photographs to compare them" if distorted else ""
    return sorted(cameras, key=lambda camera: camera.name), note


def _lens(model: str, width: int, height: int, numbers: list[float]) -> Lens:
    if model in FISHEYE:
        raise SettingError(
            f"expected pinhole cameras, got the model {model}; undistort the images first (colmap image_undistorter)"
        )
    if model in ONE_FOCAL_LENGTH:
        focal, center, rest = (numbers[0], numbers[0]), (numbers[1], numbers[2]), numbers[3:]
    else:
        focal, center, rest = (numbers[0], numbers[1]), (numbers[2], numbers[3]), numbers[4:]
    return Lens((width, height), focal, center, any(rest))


def _lenses_txt(path: Path) -> Iterator[tuple[int, Lens]]:
    counts = dict(MODELS)
    for line in path.read_text().splitlines():
        words = line.split()
        if not words or line.startswith("#"):
            continue
        number, model, width, height, *numbers = words
        if model not in counts:
            raise SettingError(f"expected a camera model of COLMAP ({', '.join(counts)}), got {model!r}")
        if len(numbers) != counts[model]:
            raise SettingError(f"expected {counts[model]} parameters of the model {model}, got {len(numbers)}")
        yield int(number), _lens(model, int(width), int(height), [float(word) for word in numbers])


def _lenses_bin(path: Path) -> Iterator[tuple[int, Lens]]:
    blob = path.read_bytes()
    (count,), at = struct.unpack_from("<Q", blob), 8
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<iiQQ", blob, at)
        if not 0 <= model < len(MODELS):
            raise SettingError(f"expected a camera model of COLMAP, got number {model}")
        name, parameters = MODELS[model]
        numbers = struct.unpack_from(f"<{parameters}d", blob, at + 24)
        at += 24 + 8 * parameters
        yield number, _lens(name, width, height, list(numbers))


def _images_txt(path: Path) -> Iterator[tuple[np.ndarray, np.ndarray, int, str]]:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    at = 0
    while at < len(lines):
        words = lines[at].split(maxsplit=9)
        if not words:  # between images, where a list of features is left out
            at += 1
            continue
        if len(words) < 10:
            raise SettingError(f"expected an image's quaternion, translation, camera and name, got {lines[at][:80]!r}")
        numbers = np.array([float(word) for word in words[1:8]])
        yield numbers[:4], numbers[4:], int(words[8]), words[9]
        at += 2


def _images_bin(path: Path) -> Iterator[tuple[np.ndarray, np.ndarray, int, str]]:
    blob = path.read_bytes()
    (count,), at = struct.unpack_from("<Q", blob), 8
    for _ in range(count):
        numbers = np.array(struct.unpack_from("<7d", blob, at + 4))
        (camera,) = struct.unpack_from("<i", blob, at + 60)
        end = blob.index(b"\0", at + 64, at + 64 + MAX_NAME_BYTES)
        name = blob[at + 64 : end].decode(errors="replace")
        (features,) = struct.unpack_from("<Q", blob, end + 1)
        at = end + 9 + FEATURE_BYTES * features
        yield numbers[:4], numbers[4:], camera, name
