"""Points of a .bin file: rows of float32 without a header, as data sets keep sweeps of a car's lidar; or COLMAP's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from z2p_core.formats.headerless_floats import (
    COLOR_COLUMNS,
    SAMPLE_NUMBERS,
    SWEEP_LAYOUTS,
    are_float64_halves,
    matching_layouts,
    suggest_columns,
)
from z2p_core.formats.raw_lidar import NUSCENES_COLUMNS, is_plausible_sweep
from z2p_core.interfaces import RawCloud, Reader, ScanError, Sensor
from z2p_renderer.plugins.readers._cameras.colmap import is_points3d, read_points3d
from z2p_renderer.plugins.readers._helpers.point_fields import plan_fields, whole_if_whole

_OPENCV_TO_LIDAR = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from OpenCV camera axes to those of a car's lidar: +X ahead, +Y to the left, +Z up."""
_UP_REASON = "a car's lidar has it so"


class Sweeps(Reader):
    """Rows of little-endian float32: x y z intensity (KITTI), and ring (nuScenes), or what --columns names.

    COLMAP's points3D.bin is read too.
    """

    name = "sweeps"
    version = "4"
    suffixes = (".bin",)

    def read(self, path: Path) -> list[RawCloud]:
        """One cloud (N, 3) float64, seen from the lidar at the origin, unless the user names the columns.

        Such a file has no header. Without named columns the layout is inferred from the numbers; files that no lidar
        could have measured are refused, since .bin has many other uses, and so are files that fit several layouts.

        Raises:
            ScanError: the file has no whole rows, or its numbers fit no layout or several.
        """
        if is_points3d(path):
            return [read_points3d(path, self.wants)]
        _refuse_float64(path)
        size = path.stat().st_size
        names = self.columns or _infer_columns(path, size)
        row = 4 * len(names)
        if size % row:
            raise ScanError(f"expected rows of float32 {' '.join(names)}, {row} bytes each, got {size} bytes; name the "
                            f"columns that it has, as in --columns {','.join(NUSCENES_COLUMNS)}")
        table = np.fromfile(path, "<f4").reshape(-1, len(names))
        if not self.columns and not is_plausible_sweep(table):
            raise _no_sweep_error(size)
        axes = [names.index(axis) for axis in "xyz"]
        plan, cloud = plan_fields(names, self.wants, axes), RawCloud(table[:, axes].astype(np.float64))
        if tuple(names) in SWEEP_LAYOUTS:
            sensor = Sensor(np.zeros(3), _OPENCV_TO_LIDAR)
            cloud = replace(cloud, sensor=sensor, up="+Z", up_reason=_UP_REASON)
        scalars = {columns[0] for name, columns in plan.columns_of.items() if name not in ("rgb", "normal")}
        columns = {column: _whole_if_whole(table[:, column]) if column in scalars else table[:, column]
                   for column in plan.columns}  # fmt: skip
        return [plan.fill(cloud, columns)]


def _whole_if_whole(values: np.ndarray) -> np.ndarray:
    """Values (N,) float32 as integers if all are whole, such as rings and labels."""
    whole = whole_if_whole(values.astype(np.float64))
    return whole if whole.dtype.kind == "i" else values


def _infer_columns(path: Path, size: int) -> tuple[str, ...]:
    """Infers the columns of a sweep from the file name or the numbers.

    Raises:
        ScanError: no layout fits, several do, or only one that no data set of sweeps has.
    """
    if path.name.lower().endswith(".pcd.bin"):
        return NUSCENES_COLUMNS
    layouts = matching_layouts(np.fromfile(path, "<f4", count=SAMPLE_NUMBERS), size)
    if len(layouts) == 1 and layouts[0] in SWEEP_LAYOUTS:
        return layouts[0]
    if not layouts:
        raise _no_sweep_error(size)
    options = " or ".join(f"--columns {','.join(layout)} ({size // (4 * len(layout))} points)" for layout in layouts)
    reason = "could be of several forms" if len(layouts) > 1 else f"look like {' '.join(layouts[0])}, no sweep's"
    raise ScanError(f"the file says nothing of its columns, and its numbers {reason}; read it with {options}")


def _refuse_float64(path: Path) -> None:
    """Refuses float64 numbers, whose halves read as float32 would be points at random positions.

    Raises:
        ScanError: the numbers are float64.
    """
    if path.stat().st_size % 8 == 0 and are_float64_halves(np.fromfile(path, "<f4", count=SAMPLE_NUMBERS)):
        raise ScanError("its numbers are float64, and z2p takes those only from files that say so; convert it: "
                        f"numpy.save({path.stem + '.npy'!r}, numpy.fromfile({path.name!r}).reshape(-1, 3)), with as "
                        "many columns as it has in place of 3")


def _no_sweep_error(size: int) -> ScanError:
    options = " or ".join(f"--columns {names}" for names in suggest_columns(size))
    advice = f"if it holds points as float32, name its columns: by its size they could be {options}" if options else (
        f"its {size} bytes are no whole rows of 3, 4, 5 or 6 numbers; if it holds points as float32, name its columns, "
        f"as in --columns {','.join(COLOR_COLUMNS)},label")
    return ScanError("expected rows of float32 x y z intensity (KITTI) or x y z intensity ring (nuScenes), got numbers "
                     f"that no lidar measures; {advice}")
