"""Points of an HDF5 file: the data sets of learning, which keep batches of objects, and arrays under usual names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.array_clouds import (
    KEYS,
    check_fields,
    check_shape,
    clouds_from_array,
    exceeds_size_limit,
    is_points,
    numbers,
    stack_axes,
)
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily

_MOST_OBJECTS, _DEEPEST = 1000, 4
"""Data sets and groups that are looked at, and how deep they may lie."""
_MOST_BYTES = 8 << 30
"""Of a data set, unpacked; one with more is refused."""


class H5(Reader):
    """HDF5 (h5py, an extra): ModelNet40, ScanObjectNN, ShapeNet, PCN, MVP and the like, a batch or a cloud."""

    name = "h5"
    version = "2"
    takes_columns = False
    packages = ("h5py",)
    suffixes = (".h5", ".hdf5")

    def is_fragile(self, path: Path) -> bool:
        """Every one: the library reckons with the addresses that it finds in the file."""
        return True

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """The clouds of the data set that is called as points are, of each group that has one; x, y and z may be apart.

        Raises:
            ScanError: no HDF5 file, a damaged one, one without points under a known name, or h5py is not installed.
        """
        return _with_file(path, _clouds)


def _with_file(path: Path, work: Callable[[Any], Any]) -> Any:
    """What `work` makes of the opened file."""
    try:
        library = import_lazily("h5py")
    except ImportError:
        raise ScanError(f"reading {path.suffix} needs an extra; {install_advice('h5')}") from None
    try:
        with library.File(path, "r") as file:
            return work(file)
    except ScanError:
        raise
    except Exception as error:  # the library raises whatever its parsing stumbles over
        raise ScanError(f"the HDF5 file cannot be read ({error_reason(error)}); save it again") from error


def _clouds(file: Any) -> list[RawCloud | np.ndarray]:
    clouds: list[RawCloud | np.ndarray] = []
    for found, key, others in _chosen(file):
        _check_size(found)
        check_fields(found.dtype)
        told = f"of {found.name.lstrip('/')}, not of {', '.join(others)}" if others else ""
        clouds += [replace(cloud, note="; ".join(filter(None, (told, cloud.note))))
                   for cloud in clouds_from_array(numbers(found[()]), key)]  # fmt: skip
    return clouds or _apart(file)


def _apart(file: Any) -> list[RawCloud | np.ndarray]:
    """One cloud of data sets x, y and z."""
    axes = {name.lower(): found for name, found in _data_sets(file) if name.lower() in ("x", "y", "z")}
    if len(axes) < 3:
        _refuse_odd_shapes(file)
        names = [name for name, _ in _data_sets(file)]
        raise ScanError(f"expected points under one of the names {', '.join(KEYS[:6])} or data, got "
                        f"{', '.join(names[:12]) or 'no data sets'}{' ...' if len(names) > 12 else ''}; save the "
                        "points as points")  # fmt: skip
    for found in axes.values():
        _check_size(found)
        check_fields(found.dtype)
    return [stack_axes({axis: found[()] for axis, found in axes.items()})]


def _refuse_odd_shapes(file: Any) -> None:
    """Raises ScanError where a data set is called as points are, and has a shape that no points have."""
    for name, found in _data_sets(file):
        if name.rpartition("/")[2].lower() in KEYS and found.shape and found.dtype.kind in "fiu":
            try:
                check_shape(found.shape)
            except ScanError as error:
                raise ScanError(f"{name}: {error}") from None


def _chosen(file: Any) -> list[tuple[Any, str, list[str]]]:
    """Of the file, or else of each of its groups, the data set that holds the points, its name, and the others'."""
    groups: dict[str, dict[str, Any]] = {}
    for name, found in _data_sets(file):
        group, _, key = name.rpartition("/")
        if key.lower() in KEYS and found.shape and is_points(found.shape, found.dtype, key.lower()):
            groups.setdefault(group, {})[key.lower()] = found
    chosen = []
    for found_in in [groups[""]] if "" in groups else groups.values():
        first, *others = (key for key in KEYS if key in found_in)
        chosen.append((found_in[first], first, others))
    return chosen


def _data_sets(file: Any) -> list[tuple[str, Any]]:
    """Names and data sets that lie in the file itself, in a fixed order; links that lead elsewhere are not followed."""
    return list(_walk(file, "", 0, iter(range(_MOST_OBJECTS))))


def _walk(group: Any, place: str, depth: int, left: Iterator[int]) -> Iterator[tuple[str, Any]]:
    """What lies in a group and below it, as long as objects are `left` to be looked at: a group may lie in itself."""
    library = import_lazily("h5py")
    for name in sorted(group):
        if next(left, None) is None:
            return
        if not isinstance(group.get(name, getlink=True), library.HardLink):
            continue
        found = group[name]
        if isinstance(found, library.Dataset):
            yield f"{place}{name}", found
        elif depth < _DEEPEST:
            yield from _walk(found, f"{place}{name}/", depth + 1, left)


def _check_size(found: Any) -> None:
    """Raises ScanError for a data set that lies elsewhere, or packs more than clouds could."""
    if found.is_virtual or found.external:
        raise ScanError(f"{found.name} lies in other files, which are not opened; save its points in one file")
    size, packed = int(np.prod(found.shape, dtype=object)) * found.dtype.itemsize, found.id.get_storage_size()
    if exceeds_size_limit(size, packed, _MOST_BYTES):
        raise ScanError(f"{found.name} would unpack to {size} bytes from {packed}; save fewer clouds, as .npy for one")
