"""Shards: one HDF5 file per mesh, with its renders and the pool of points that training draws clouds from.

One writer, never appended to: a file appears under its name only when it is complete. Each sample is one chunk, packed
with gzip and checked by Fletcher-32; the format of HDF5 1.10 also has checksums for the file's own bookkeeping.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from z2p_core.errors.messages import UserError
from z2p_core.errors.value_limits import (
    AnyOf,
    Boolean,
    Count,
    JsonObject,
    ListOf,
    MappingOf,
    Number,
    OrNone,
    Text,
    check_value,
)
from z2p_core.scene import SceneDescription
from z2p_renderer.storage.files.atomic_write import atomic_path

SCHEMA = 3
MAX_SCENE_BYTES = 1024
"""Room for a scene as JSON: fixed-length strings read the same from every thread."""
_NUMBER, _NAME = Number(-1e9, 1e9), Text("a line of text")
ATTRIBUTES = JsonObject({
    "schema": Count(SCHEMA, SCHEMA), "mesh": _NAME, "resolution": Count(1, 1 << 16),
    "controls": ListOf(JsonObject({"name": _NAME, "version": _NAME, "size": Count(1, 1000)}), 1, 1000),
}, {"textured": Boolean()})  # fmt: skip
"""What a shard's attributes may be; more may be there."""
MAX_TEXTURE_BYTES = 512
"""Room for a texture as JSON."""
TEXTURE = OrNone(JsonObject({"name": _NAME, "seed": ListOf(Count(0, 1 << 128), 1, 100)}))
"""The name of a texture plugin and the seed of its random numbers; null for a mesh in one color."""
SCENE = JsonObject(
    {"elevation": _NUMBER, "lift": _NUMBER, "light": ListOf(_NUMBER, 3, 3),
     "rotation": ListOf(ListOf(_NUMBER, 3, 3), 3, 3),
     "material": MappingOf(AnyOf((_NUMBER, ListOf(_NUMBER, 1, 4))))},
    {"floor": OrNone(_NUMBER)},
)  # fmt: skip
HDF5_FORMAT = ("v110", "v110")
"""Oldest and newest HDF5 that must understand the file: that of 1.10 is the oldest format whose bookkeeping all has
checksums, and every h5py that can be installed reads it. The ``latest`` changes with the library that writes: what
HDF5 2.0 calls so, no 1.14 can open."""
MAX_COMPRESSION_RATIO = 1200
"""More than gzip can pack bytes (about 1,030 to 1); a file that declares more lies about its size."""


class ShardError(UserError):
    """A shard that cannot be used; the message names the file, what was expected and what came."""


@dataclass(frozen=True)
class Record:
    """One render of one mesh, R pixels a side."""

    rgba: np.ndarray
    """(R, R, 4) uint8, straight sRGB and alpha."""
    coverage: np.ndarray
    """(R, R) uint8, how much of the pixel the object covers, without its shadow."""
    settings: np.ndarray
    """(S,) float32, the settings vector as the controls encode it."""
    mirrored_settings: np.ndarray
    """(S,) float32, that of the same scene with left and right exchanged."""
    scene: SceneDescription
    """What was rendered."""
    texture: dict[str, Any] | None = None
    """``name`` and ``seed`` of the texture that gave the mesh its colors; None for the color of the settings."""


def write_shard(path: Path, records: Iterable[Record], pool: np.ndarray, attributes: dict[str, Any]) -> str:
    """SHA-256 of the shard now complete under `path`; nothing is left under that name if it fails.

    `pool` is (P, 3), normalised to the mesh's sphere and not rotated. `attributes` must have `mesh` (a name),
    `controls` (a list of {name, version, size} in the settings vector's order) and `resolution`; more may be there.
    `textured` says whether the records' textures are kept.

    Raises:
        ShardError: no record, or one whose shape does not fit the attributes.
    """
    kept = list(records)
    attributes = {"schema": SCHEMA, **attributes}
    layout = _layout(len(kept), len(pool), attributes, path)
    with atomic_path(path) as temporary:
        with h5py.File(temporary, "w", libver=HDF5_FORMAT) as file:
            file.attrs["z2p"] = np.bytes_(json.dumps(attributes, sort_keys=True).encode())
            for name, (shape, dtype) in layout.items():
                chunk = shape if name == "pool" else (1, *shape[1:])
                data = file.create_dataset(
                    name, shape, dtype, chunks=chunk, compression="gzip", compression_opts=4, shuffle=True,
                    fletcher32=True,
                )
                if name == "pool":
                    data[...] = pool
                else:
                    for row, record in enumerate(kept):
                        where = f"{path}: record {row}: {name}"
                        data[row] = _check_shape(_stored(record, name, where), shape[1:], where)
        digest = _fsync_and_digest(temporary)
    return digest


class Shard:
    """Reader of one shard. Opens its file on first use and again in every process, so it may cross a fork."""

    def __init__(self, path: Path) -> None:
        """Checks the whole layout of the file, and reads nothing but the attributes.

        Raises:
            ShardError: not a shard, truncated, damaged, or of another schema.
        """
        self.path = Path(path)
        self._file: h5py.File | None = None
        self._process = 0
        try:
            file = self._open()
            self.attributes: dict[str, Any] = _read_attributes(file, self.path)
            self._count = _check_layout(file, self.attributes, self.path)
        except Exception as error:  # h5py raises whatever a damaged file makes it stumble over
            self.close()
            raise self._damaged(error) from error

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> Record:
        """Record `index`, 0 to len - 1.

        Raises:
            IndexError: there is no such record.
            ShardError: its data are damaged.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"{self.path}: record {index} of {len(self)}")
        try:
            file = self._open()
            arrays = {name: file[name][index] for name in ("rgba", "coverage", "settings", "mirrored_settings")}
            for name in ("settings", "mirrored_settings"):
                _check_finite(arrays[name], f"record {index}: {name}")
            texture = _texture(file["texture"][index]) if self.attributes.get("textured") else None
            return Record(**arrays, scene=_scene(file["scene"][index]), texture=texture)
        except Exception as error:  # as above
            raise self._damaged(error) from error

    @property
    def pool(self) -> np.ndarray:
        """Points (P, 3) float32 of the normalised mesh, not rotated.

        Raises:
            ShardError: its data are damaged.
        """
        pool = self._whole("pool")
        try:
            _check_finite(pool, "pool")
        except ValueError as error:
            raise self._damaged(error) from error
        return pool

    @property
    def elevations(self) -> np.ndarray:
        """Camera elevations (len,) float64 of all records, degrees.

        Raises:
            ShardError: its data are damaged.
        """
        try:
            return np.array([_scene(text).elevation for text in self._whole("scene")])
        except (RuntimeError, ValueError) as error:
            raise self._damaged(error) from error

    def close(self) -> None:
        """Let go of the file; the next reading opens it again."""
        if self._file is not None and self._process == os.getpid():
            self._file.close()
        self._file = None

    def _whole(self, name: str) -> np.ndarray:
        try:
            data: np.ndarray = self._open()[name][...]
            return data
        except Exception as error:  # as above
            raise self._damaged(error) from error

    def _open(self) -> h5py.File:
        if self._file is None or self._process != os.getpid():
            self._file = h5py.File(self.path, "r", locking=False)
            self._process = os.getpid()
        return self._file

    def _damaged(self, error: Exception) -> ShardError:
        if isinstance(error, ShardError):
            return error
        if not self.path.is_file():
            return ShardError(f"{self.path}: no such shard")
        return ShardError(f"{self.path}: truncated, damaged or not a shard ({error}); shard this mesh again")


def _layout(
    count: int, points: int, attributes: dict[str, Any], path: Path
) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Shape and type of each data set."""
    missing = sorted({"schema", "mesh", "controls", "resolution"} - set(attributes))
    if missing or not count or not points:
        raise ShardError(f"{path}: expected records, points and attributes, got {count}, {points}, without {missing}")
    side = int(attributes["resolution"])
    settings = sum(int(control["size"]) for control in attributes["controls"])
    textures = {"texture": ((count,), np.dtype(f"S{MAX_TEXTURE_BYTES}"))} if attributes.get("textured") else {}
    return {
        "rgba": ((count, side, side, 4), np.uint8),
        "coverage": ((count, side, side), np.uint8),
        "settings": ((count, settings), np.float32),
        "mirrored_settings": ((count, settings), np.float32),
        "scene": ((count,), np.dtype(f"S{MAX_SCENE_BYTES}")),
        "pool": ((points, 3), np.float32),
        **textures,
    }


def _stored(record: Record, name: str, where: str) -> Any:
    """A record's value as the data set `name` holds it."""
    if name == "scene":
        return _json_bytes(record.scene.to_json(), MAX_SCENE_BYTES, where)
    if name == "texture":
        return _json_bytes(record.texture, MAX_TEXTURE_BYTES, where)
    return getattr(record, name)


def _json_bytes(value: Any, limit: int, where: str) -> bytes:
    text = json.dumps(value, separators=(",", ":")).encode()
    if len(text) > limit:
        raise ShardError(f"{where}: expected at most {limit} bytes of JSON, got {len(text)}")
    return text


def _texture(text: bytes) -> dict[str, Any] | None:
    texture: dict[str, Any] | None = json.loads(bytes(text))
    check_value(texture, TEXTURE, "texture")
    return texture


def _scene(text: bytes) -> SceneDescription:
    scene = json.loads(bytes(text))
    check_value(scene, SCENE, "scene")
    return SceneDescription.from_json(scene)


def _check_finite(array: np.ndarray, where: str) -> None:
    """
    Raises:
        ValueError: a number is none.
    """
    if not np.isfinite(array).all():
        raise ValueError(f"{where} holds numbers that are not finite")


def _check_shape(value: Any, shape: tuple[int, ...], where: str) -> Any:
    if np.shape(value) != shape:
        raise ShardError(f"{where}: expected shape {shape}, got {np.shape(value)}")
    return value


def _fsync_and_digest(path: Path) -> str:
    """SHA-256 of a finished file whose bytes are on the disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read_attributes(file: h5py.File, path: Path) -> dict[str, Any]:
    attributes: dict[str, Any] = json.loads(bytes(file.attrs["z2p"]))
    if isinstance(attributes, dict) and isinstance(schema := attributes.get("schema"), int) and schema != SCHEMA:
        raise ShardError(f"{path}: expected schema {SCHEMA}, got {schema}; shard this mesh again")
    check_value(attributes, ATTRIBUTES, "attributes")
    return attributes


def _check_layout(file: h5py.File, attributes: dict[str, Any], path: Path) -> int:
    """How many records, once every data set is plain, complete and no larger than the file can hold."""
    for name in file:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
            raise ShardError(f"{path}: {name} is a link or a group; shards hold plain data sets only")
    count, points = len(file["rgba"]), len(file["pool"])
    size = path.stat().st_size
    for name, (shape, dtype) in _layout(count, points, attributes, path).items():
        data = file[name]
        if data.external or data.is_virtual:
            raise ShardError(f"{path}: {name} lies in other files; shards hold their own data only")
        if data.shape != shape or data.dtype != dtype:
            raise ShardError(f"{path}: {name}: expected {shape} {np.dtype(dtype)}, got {data.shape} {data.dtype}")
        if data.nbytes > size * MAX_COMPRESSION_RATIO:
            raise ShardError(f"{path}: {name} declares {data.nbytes} bytes, more than {size} bytes of file can hold")
        chunks = 1 if name == "pool" else count
        if data.chunks is None or data.id.get_num_chunks() != chunks:
            raise ShardError(f"{path}: {name}: expected {chunks} written chunks; the file was never finished")
    return count
