"""Points of numpy arrays: one cloud, or a batch of them, in npy and npz."""

from __future__ import annotations

import zipfile
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.formats.arrays.depth_maps import find_depth_and_camera, unproject_depth
from z2p_core.formats.row_subsampling import BLOCK_BYTES, subsample_blocks
from z2p_core.interfaces import MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.array_clouds import (
    MAX_COLUMNS,
    NO_FIELD_KEYS,
    POINT_KEYS,
    check_fields,
    check_shape,
    clouds_from_array,
    exceeds_size_limit,
    is_points,
    plain_numbers,
    record_fields,
    stack_axes,
)
from z2p_renderer.plugins.readers._helpers.array_fields import SideArrays, joined, with_array_fields
from z2p_renderer.plugins.readers._helpers.point_fields import Wants

_MAX_MEMBER_BYTES = 2 << 30
"""Larger members of an npz, unpacked, are refused."""
_ATTRIBUTE_WORDS = ("normal", "color", "colour", "rgb", "feat", "conf", "mask", "depth")
"""Words in the names of arrays that hold attributes of points, not points."""
_AXIS_NAMES = {"x", "y", "z"}
_AMBIGUOUS_COLUMNS = (4, 5)
"""Arrays of this many columns count as points only under a known name: four may be a color or a rotation."""
_MIN_UNNAMED_ROWS = 5
"""Arrays with fewer rows count as points only under a known name: they may be a camera matrix."""

_MAX_SUBSAMPLED_COLUMNS = 35
"""Columns that are kept of a cloud of very many points."""


class NumpyArrays(Reader):
    """Numpy arrays (N, 3 or more: the first three count), batches of these, and depth cameras' point maps."""

    name = "numpy"
    version = "6"
    takes_columns = False
    suffixes = (".npy", ".npz")

    def memory(self, path: Path) -> int:
        """That of the arrays; of a very large cloud only a subsample is read."""
        if path.suffix.lower() == ".npy":
            try:
                with path.open("rb") as file:
                    if _is_subsampled(*_read_header(file, path.stat().st_size), self.max_rows):
                        return self.max_rows * MEMORY_A_POINT + 2 * BLOCK_BYTES
            except Exception:  # numpy raises errors of any type; read reports them
                return 0
        return super().memory(path)

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """One cloud (N, 3) float64, or B of them from a batch; of an npz the array `points`, `xyz` ..., or `x`, `y` and
        `z`, or the only one, or `depth` by its camera's matrix `K`.

        A point map (H, W, 3) of a pinhole camera is one cloud with that camera as its sensor; maps of several cameras
        (B, H, W, 3) are as many clouds.

        A single cloud of very many points in an npy is subsampled.

        Raises:
            ScanError: another shape, no numbers, pickled objects, or a size that the file cannot hold.
        """
        try:
            if path.suffix.lower() == ".npz":
                return list(_read_npz(path, self.wants))
            with path.open("rb") as file:
                shape, column_major, dtype = _read_header(file, path.stat().st_size)
                if _is_subsampled(shape, column_major, dtype, self.max_rows):
                    return [_read_subsampled(file, shape, dtype, self.wants, self.max_rows)]
                array = _read_array(file, path.stat().st_size)
            return list(clouds_from_array(plain_numbers(array), "", self.wants, record_fields(array)))
        except ScanError:
            raise
        except Exception as error:  # zipfile, zlib and numpy raise errors of any type
            raise ScanError(f"expected a numpy file ({error_reason(error)}); "
                            "save it again with numpy.save or numpy.savez") from error


def _read_npz(path: Path, wants: Wants) -> list[RawCloud]:
    """The clouds of the array that holds the points, with fields of those beside it."""
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        if members.keys() >= _AXIS_NAMES and not members.keys() & set(POINT_KEYS):
            points, side = _read_axes(archive, members, size), _side_arrays(archive, members, _AXIS_NAMES, size)
            return clouds_from_array(points, "", wants, side)
        chosen = _choose_member(archive, members, size)
        if chosen is None and (names := find_depth_and_camera(members)):
            depth, camera = (plain_numbers(_read_member(archive, name, members[name], size)) for name in names)
            side = _side_arrays(archive, members, set(names[1:]), size)
            return clouds_from_array(unproject_depth(depth, camera), "point_map", wants, side)
        if chosen is None:
            raise ScanError(f"expected an array named 'points' or 'xyz', or one array of floats (N, 3) alone, got "
                            f"{', '.join(members) or 'none'}; save the points as points=...")
        array = _read_member(archive, chosen, members[chosen], size)
        side = joined(record_fields(array), _side_arrays(archive, members, {chosen}, size))
        return clouds_from_array(plain_numbers(array), chosen, wants, side)


def _side_arrays(
    archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo], others: Collection[str], size: int
) -> SideArrays:
    """The arrays of numbers in an archive but `others`."""
    shapes: dict[str, tuple[int, ...]] = {}
    for name, info in members.items():
        if name not in others and name.lower() not in NO_FIELD_KEYS:
            with archive.open(info) as file, suppress(ValueError):  # no array of numbers
                shapes[name] = _read_side_header(file)
    return SideArrays(shapes, lambda name: _read_member(archive, name, members[name], size))


def _read_side_header(file: IO[bytes]) -> tuple[int, ...]:
    """The shape of an array of numbers or truth values.

    Raises:
        ValueError: it holds something else.
    """
    version = np.lib.format.read_magic(file)
    parse = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if parse is None:
        raise ValueError(version)
    shape, _, dtype = parse(file)
    if dtype.kind not in "fiub":
        raise ValueError(dtype)
    return tuple(shape)


def _read_member(archive: zipfile.ZipFile, name: str, info: zipfile.ZipInfo, size: int) -> np.ndarray:
    """The array of that name in an archive of `size` bytes."""
    _check_member_size(name, info, size)
    with archive.open(info) as file:
        return _read_array(file, info.file_size)


def _read_axes(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo], size: int) -> np.ndarray:
    """Points (N, 3) of arrays x, y and z, of any shape but the same."""
    return stack_axes({axis: plain_numbers(_read_member(archive, axis, members[axis], size)) for axis in "xyz"})


def _choose_member(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo], size: int) -> str | None:
    """Name of the array of points: one with a known name, or the only one that could be points; None if neither exists.

    An array with a known name but another shape is returned too: its error message then says what is wrong.
    """
    named = [key for key in POINT_KEYS if key in members]
    for key in named:
        _check_member_size(key, members[key], size)
        if _could_be_points(archive, members[key]):
            return key
    if named or len(members) == 1:
        return next(iter(named or members))
    others = [key for key in members if not any(word in key.lower() for word in _ATTRIBUTE_WORDS)]
    floats = [key for key in others if _could_be_points(archive, members[key], floats=True)]
    return floats[0] if len(floats) == 1 else None


def _could_be_points(archive: zipfile.ZipFile, info: zipfile.ZipInfo, floats: bool = False) -> bool:
    """Whether an array's header fits points; `floats` asks for an array that is recognizable without a known name."""
    with archive.open(info) as file:
        try:
            shape, _, dtype = _read_header(file, info.file_size)
        except ValueError:  # no array of numbers
            return False
    if not is_points(shape, dtype, info.filename.removesuffix(".npy")):
        return False
    return not floats or (dtype.kind == "f" and (len(shape) == 4 or (shape[-2] >= _MIN_UNNAMED_ROWS
                                                                     and shape[-1] not in _AMBIGUOUS_COLUMNS)))


def _check_member_size(name: str, info: zipfile.ZipInfo, size: int) -> None:
    """Raises ScanError for an array that is too large or too compressible for a file of `size` bytes."""
    if exceeds_size_limit(info.file_size, info.compress_size, _MAX_MEMBER_BYTES) or info.compress_size > size:
        raise ScanError(f"array {name!r} would unpack to {info.file_size} bytes from {info.compress_size}; "
                        "that is no cloud: save it again as .npy if it is one")


def _read_array(file: IO[bytes], size: int) -> np.ndarray:
    """Reads the array in an npy stream of `size` bytes, after its header has been checked against them."""
    shape, column_major, dtype = _read_header(file, size)
    content = memoryview(bytearray(size - file.tell()))
    filled = 0
    while filled < len(content) and (step := file.readinto(content[filled:])):  # type: ignore[attr-defined]
        filled += step
    if filled < len(content):
        raise ScanError(f"{len(content) - filled} bytes of the array are missing; the file is cut short: save it again")
    array = np.frombuffer(content, dtype)
    return array.reshape(shape[::-1]).T if column_major else array.reshape(shape)


def _is_subsampled(shape: tuple[int, ...], column_major: bool, dtype: np.dtype, max_rows: int) -> bool:
    """Whether this is a single row-major cloud of more points than are read."""
    return len(shape) == 2 and 3 <= shape[1] <= MAX_COLUMNS and shape[0] > max_rows and not column_major


def _read_subsampled(file: IO[bytes], shape: tuple[int, ...], dtype: np.dtype, wants: Wants, max_rows: int) -> RawCloud:
    """Subsamples the rows behind a header, which are read in blocks."""
    check_shape(shape)
    row, width = shape[1] * dtype.itemsize, min(shape[1], _MAX_SUBSAMPLED_COLUMNS)
    parts = []
    for rows, kept in subsample_blocks(shape[0], row, np.random.default_rng(0), max_rows):
        parts.append(np.frombuffer(file.read(rows * row), dtype).reshape(rows, shape[1])[kept, :width])
    table = np.concatenate(parts)
    cloud = RawCloud(np.ascontiguousarray(table[:, :3], dtype=np.float64), total=shape[0])
    return with_array_fields([cloud], table, SideArrays(), wants)[0]


def _read_header(file: IO[bytes], size: int) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, column-major flag and dtype of an npy stream of `size` bytes; moves the stream to the array.

    Raises:
        ScanError: the array would not fill the rest of the stream exactly, or holds no numbers.
    """
    file.seek(0)
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ScanError(f"npy format {version} holds no plain array; save the points with numpy.save")
    parse = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, column_major, dtype = parse(file)
    check_fields(dtype)
    promised = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if promised != size - file.tell():
        raise ScanError(f"the npy header promises {shape} {dtype}, {promised} bytes, but {size - file.tell()} follow; "
                        "the file is cut short: save it again")
    return shape, column_major, dtype
