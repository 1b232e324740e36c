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
    POINT_KEYS,
    check_fields,
    check_shape,
    clouds_from_array,
    exceeds_size_limit,
    is_points,
    plain_numbers,
    stack_axes,
)
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily

_MAX_OBJECTS, _MAX_GROUP_DEPTH = 1000, 4
"""Data sets and groups that are looked at, and how deep they may lie."""
_MAX_DATASET_BYTES = 8 << 30
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
        return _with_file(path, _read_clouds)


def _with_file(path: Path, read: Callable[[Any], Any]) -> Any:
    """What `read` makes of the opened file."""
    try:
        library = import_lazily("h5py")
    except ImportError:
        raise ScanError(f"reading {path.suffix} needs an extra; {install_advice('h5')}") from None
    try:
        with library.File(path, "r") as file:
            return read(file)
    except ScanError:
        raise
    except Exception as error:  # the library raises whatever its parsing stumbles over
        raise ScanError(f"the HDF5 file cannot be read ({error_reason(error)}); save it again") from error


def _read_clouds(file: Any) -> list[RawCloud | np.ndarray]:
    clouds: list[RawCloud | np.ndarray] = []
    for dataset, key, others in _choose_datasets(file):
        _check_size(dataset)
        check_fields(dataset.dtype)
        name_note = f"of {dataset.name.lstrip('/')}, not of {', '.join(others)}" if others else ""
        clouds += [replace(cloud, note="; ".join(filter(None, (name_note, cloud.note))))
                   for cloud in clouds_from_array(plain_numbers(dataset[()]), key)]  # fmt: skip
    return clouds or _cloud_from_axes(file)


def _cloud_from_axes(file: Any) -> list[RawCloud | np.ndarray]:
    """One cloud of data sets x, y and z."""
    axes = {name.lower(): dataset for name, dataset in _list_datasets(file) if name.lower() in ("x", "y", "z")}
    if len(axes) < 3:
        _refuse_odd_shapes(file)
        names = [name for name, _ in _list_datasets(file)]
        raise ScanError(f"expected points under one of the names {', '.join(POINT_KEYS[:6])} or data, got "
                        f"{', '.join(names[:12]) or 'no data sets'}{' ...' if len(names) > 12 else ''}; save the "
                        "points as points")  # fmt: skip
    for dataset in axes.values():
        _check_size(dataset)
        check_fields(dataset.dtype)
    return [stack_axes({axis: dataset[()] for axis, dataset in axes.items()})]


def _refuse_odd_shapes(file: Any) -> None:
    """Raises ScanError where a data set is called as points are, and has a shape that no points have."""
    for name, dataset in _list_datasets(file):
        if name.rpartition("/")[2].lower() in POINT_KEYS and dataset.shape and dataset.dtype.kind in "fiu":
            try:
                check_shape(dataset.shape)
            except ScanError as error:
                raise ScanError(f"{name}: {error}") from None


def _choose_datasets(file: Any) -> list[tuple[Any, str, list[str]]]:
    """Of the file, or else of each of its groups, the data set that holds the points, its name, and the others'."""
    groups: dict[str, dict[str, Any]] = {}
    for name, dataset in _list_datasets(file):
        group, _, key = name.rpartition("/")
        if key.lower() in POINT_KEYS and dataset.shape and is_points(dataset.shape, dataset.dtype, key.lower()):
            groups.setdefault(group, {})[key.lower()] = dataset
    choices = []
    for datasets in [groups[""]] if "" in groups else groups.values():
        first, *others = (key for key in POINT_KEYS if key in datasets)
        choices.append((datasets[first], first, others))
    return choices


def _list_datasets(file: Any) -> list[tuple[str, Any]]:
    """Names and data sets that lie in the file itself, in a fixed order; links that lead elsewhere are not followed."""
    return list(_iter_datasets(file, "", 0, iter(range(_MAX_OBJECTS))))


def _iter_datasets(group: Any, prefix: str, depth: int, budget: Iterator[int]) -> Iterator[tuple[str, Any]]:
    """What lies in a group and below it, as long as objects are `budget` to be looked at: a group may lie in itself."""
    library = import_lazily("h5py")
    for name in sorted(group):
        if next(budget, None) is None:
            return
        if not isinstance(group.get(name, getlink=True), library.HardLink):
            continue
        dataset = group[name]
        if isinstance(dataset, library.Dataset):
            yield f"{prefix}{name}", dataset
        elif depth < _MAX_GROUP_DEPTH:
            yield from _iter_datasets(dataset, f"{prefix}{name}/", depth + 1, budget)


def _check_size(dataset: Any) -> None:
    """Raises ScanError for a data set that lies elsewhere, or packs more than clouds could."""
    if dataset.is_virtual or dataset.external:
        raise ScanError(f"{dataset.name} lies in other files, which are not opened; save its points in one file")
    size, packed = int(np.prod(dataset.shape, dtype=object)) * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if exceeds_size_limit(size, packed, _MAX_DATASET_BYTES):
        raise ScanError(f"{dataset.name} would unpack to {size} bytes from {packed}; save fewer clouds, as .npy for one")
