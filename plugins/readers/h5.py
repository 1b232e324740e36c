"""Points of an HDF5 file: batches of objects, as data sets for machine learning keep them, or single clouds."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.array_clouds import (
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
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.point_fields import Wants

_MAX_OBJECTS, _MAX_GROUP_DEPTH = 1000, 4
"""How many data sets and groups are visited, and how deep groups may be nested."""
_MAX_DATASET_BYTES = 8 << 30
"""Larger data sets, unpacked, are refused."""


class H5(Reader):
    """HDF5 (h5py, an extra): ModelNet40, ScanObjectNN, ShapeNet, PCN, MVP and the like, a batch or a cloud."""

    name = "h5"
    version = "3"
    takes_columns = False
    packages = ("h5py",)
    suffixes = (".h5", ".hdf5")

    def is_fragile(self, path: Path) -> bool:
        """Every file: the library follows the addresses in it without a check."""
        return True

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """Reads the data set that is named like points, in the file or in each group, or data sets x, y and z.

        Raises:
            ScanError: no HDF5 file, a damaged one, one without points under a known name, or h5py is not installed.
        """
        return _with_file(path, lambda file: _read_clouds(file, self.wants))


def _with_file(path: Path, read: Callable[[Any], Any]) -> Any:
    """Opens the file and returns what `read` makes of it."""
    try:
        library = import_lazily("h5py")
    except ImportError:
        raise ScanError(f"reading {path.suffix} needs an extra; {install_advice('h5')}") from None
    try:
        with library.File(path, "r") as file:
            return read(file)
    except ScanError:
        raise
    except Exception as error:  # the library raises errors of any type on damaged files
        raise ScanError(f"the HDF5 file cannot be read ({error_reason(error)}); save it again") from error


def _read_clouds(file: Any, wants: Wants) -> list[RawCloud | np.ndarray]:
    clouds: list[RawCloud | np.ndarray] = []
    for dataset, key, others in _choose_datasets(file):
        _check_size(dataset)
        check_fields(dataset.dtype)
        name_note = f"of {dataset.name.lstrip('/')}, not of {', '.join(others)}" if others else ""
        array = dataset[()]
        side = joined(record_fields(array), _side_arrays(file, dataset.name.strip("/").rpartition("/")[0], {key}))
        clouds += [replace(cloud, note="; ".join(filter(None, (name_note, cloud.note))))
                   for cloud in clouds_from_array(plain_numbers(array), key, wants, side)]  # fmt: skip
    return clouds or _cloud_from_axes(file, wants)


def _side_arrays(file: Any, group: str, others: Collection[str]) -> SideArrays:
    """The data sets of numbers in a group, but those of the names `others`, lower-case."""
    datasets: dict[str, Any] = {}
    for name, dataset in _list_datasets(file):
        place, _, key = name.rpartition("/")
        is_usable = place == group and key.lower() not in {*others, *NO_FIELD_KEYS} and dataset.dtype.kind in "fiub"
        if is_usable and dataset.shape and _is_loadable(dataset):
            datasets[key] = dataset
    return SideArrays({key: dataset.shape for key, dataset in datasets.items()}, lambda key: datasets[key][()])


def _is_loadable(dataset: Any) -> bool:
    try:
        _check_size(dataset)
    except ScanError:
        return False
    return True


def _cloud_from_axes(file: Any, wants: Wants) -> list[RawCloud | np.ndarray]:
    """One cloud from the data sets x, y and z."""
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
    points = stack_axes({axis: plain_numbers(dataset[()]) for axis, dataset in axes.items()})
    group = axes["x"].name.strip("/").rpartition("/")[0]
    side = _side_arrays(file, group, set("xyz"))
    return list(with_array_fields([RawCloud(points.astype(np.float64))], points, side, wants))


def _refuse_odd_shapes(file: Any) -> None:
    """Raises ScanError if a data set is named like points but has another shape."""
    for name, dataset in _list_datasets(file):
        if name.rpartition("/")[2].lower() in POINT_KEYS and dataset.shape and dataset.dtype.kind in "fiu":
            try:
                check_shape(dataset.shape)
            except ScanError as error:
                raise ScanError(f"{name}: {error}") from None


def _choose_datasets(file: Any) -> list[tuple[Any, str, list[str]]]:
    """The data set of points in the file, or else in each group: the data set, its name, and the other candidates'."""
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
    """Names and data sets in the file itself, in a fixed order; links to other files are not followed."""
    return list(_iter_datasets(file, "", 0, iter(range(_MAX_OBJECTS))))


def _iter_datasets(group: Any, prefix: str, depth: int, budget: Iterator[int]) -> Iterator[tuple[str, Any]]:
    """The data sets in a group and below it, up to the `budget` of objects: a group may contain itself."""
    library = import_lazily("h5py")
    for name in sorted(group):
        if next(budget, None) is None:
            return
        if not isinstance(group.get(name, getlink=True), library.HardLink):
            continue
        member = group[name]
        if isinstance(member, library.Dataset):
            yield f"{prefix}{name}", member
        elif depth < _MAX_GROUP_DEPTH:
            yield from _iter_datasets(member, f"{prefix}{name}/", depth + 1, budget)


def _check_size(dataset: Any) -> None:
    """Raises ScanError for a data set that lies in other files, or is too large or too compressible for a cloud."""
    if dataset.is_virtual or dataset.external:
        raise ScanError(f"{dataset.name} lies in other files, which are not opened; save its points in one file")
    size, packed = int(np.prod(dataset.shape, dtype=object)) * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if exceeds_size_limit(size, packed, _MAX_DATASET_BYTES):
        raise ScanError(f"{dataset.name} would unpack to {size} bytes from {packed}; save fewer clouds, as .npy for "
                        "one")
