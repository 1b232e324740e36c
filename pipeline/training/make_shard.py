"""Packs a mesh's renders and its pool of points into one HDF5 shard, at the resolution that training reads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from z2p_core.config import ConfigError, ShardConfig
from z2p_core.images import area_average, bytes_from_unit, shrink, unit_from_bytes
from z2p_core.interfaces import Control
from z2p_core.scene import SceneDescription
from z2p_core.settings import settings_vector
from z2p_renderer.storage.shards import Record, write_shard


def make_shard(
    render_dirs: Sequence[Path],
    pool_path: Path,
    config: ShardConfig,
    controls: dict[str, Control],
    out: Path,
    mesh: str = "",
) -> Path:
    """``out/shard.h5`` with every view of the render folders, by view number, and the pool (P, 3) of points.

    Renders larger than the shard's resolution are area-averaged in linear premultiplied light. The settings vector is
    the controls' encodings, concatenated in their order. `mesh` is the name that the shard stores. Views with a
    ``texture``, be it null, make a shard that keeps their textures.

    Raises:
        ConfigError: the shard's resolution does not divide the renders'.
        FileNotFoundError: the folders hold no view, or a picture of one is missing.
    """
    views = sorted((path for folder in render_dirs for path in folder.glob("view_*.json")), key=lambda path: path.name)
    if not views:
        raise FileNotFoundError(f"expected views (view_NNNNN.json) in {', '.join(map(str, render_dirs))}, found none")
    attributes = {
        "mesh": mesh or "unnamed",
        "controls": [
            {"name": control.name, "version": control.version, "size": control.size} for control in controls.values()
        ],
        "resolution": config.resolution,
    }
    if "texture" in json.loads(views[0].read_text(encoding="utf-8")):
        attributes["textured"] = True
    out.mkdir(parents=True, exist_ok=True)
    records = (read_view(path, config.resolution, controls) for path in views)
    write_shard(out / "shard.h5", records, np.load(pool_path, allow_pickle=False), attributes)
    return out / "shard.h5"


def read_view(path: Path, resolution: int, controls: dict[str, Control]) -> Record:
    """Record of a rendered view, downsampled to `resolution`; its images lie beside `path`, its ``view_NNNNN.json``.

    Raises:
        ConfigError: the resolution does not divide the render's.
        FileNotFoundError: a picture is missing.
    """
    view = json.loads(path.read_text(encoding="utf-8"))
    scene = SceneDescription.from_json(view["scene"])
    rgba = np.asarray(Image.open(path.with_suffix(".png")).convert("RGBA"))
    coverage = np.asarray(Image.open(path.with_suffix(".coverage.png")).convert("L"))
    factor, rest = divmod(rgba.shape[0], resolution)
    if rest or factor < 1:
        raise ConfigError(f"shard.resolution: expected a divisor of the renders' {rgba.shape[0]}, got {resolution}")
    rgba, coverage = downsample_images(rgba, coverage, factor)
    values = {name: tuple(view["values"][name]) for name in controls}
    turned = {name: control.mirrored(values[name]) for name, control in controls.items()}
    return Record(
        rgba=rgba,
        coverage=coverage,
        settings=settings_vector(values, controls),
        mirrored_settings=settings_vector(turned, controls),
        scene=scene,
        texture=view.get("texture"),
    )


def downsample_images(rgba: np.ndarray, coverage: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Image (H, W, 4) and coverage (H, W), both uint8, downsampled by `factor` in linear light."""
    if factor == 1:
        return rgba, coverage
    smaller = bytes_from_unit(shrink(unit_from_bytes(rgba), factor))
    return smaller, bytes_from_unit(area_average(unit_from_bytes(coverage), factor))
