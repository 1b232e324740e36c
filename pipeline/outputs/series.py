"""The clouds of a film in order: files that are read when needed, or arrays; and clouds between two that match."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from z2p_core.coloring.options import ColorOptions
from z2p_core.interfaces import ScanError
from z2p_core.surface.subsampling import subsample_uniform
from z2p_renderer.pipeline.batch.common_view import CloudGroup
from z2p_renderer.pipeline.coloring.fields import read_scans
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.scans.clouds import PointFields, Scan, format_suffix

MAX_MATCHED_POINTS = 5000
"""Points of each of two clouds by which their order is compared."""
MIN_EXPLAINED_SHARE = 0.5
"""Share of a cloud's variance that an affine map from the one before explains if the points have the same order; with
unrelated orders it is near 0."""


@dataclass
class CloudSeries:
    """Clouds in the order of a film. Of files, only the two read last are kept in memory."""

    groups: Sequence[CloudGroup]
    """What is read together: the clouds of one file, one after another."""
    on_failure: Callable[[str], None] = field(default=lambda line: None)
    """Called with a line on each file that cannot be read; its clouds are left out."""

    def __post_init__(self) -> None:
        self._recent: dict[int, Sequence[Scan]] = {}
        self._places: list[tuple[int, int]] | None = None

    @property
    def places(self) -> list[tuple[int, int]]:
        """The group of each cloud, and which of its clouds it is; the first use reads all files once.

        Raises:
            ScanError: no file can be read.
        """
        if self._places is None:
            self._places = []
            errors = []
            for number, group in enumerate(self.groups):
                try:
                    count = len(self._read(number))
                except (ScanError, OSError, MemoryError) as error:
                    text = str(error) or "not enough memory"
                    errors.append(text if text.startswith(group.name) else f"{group.name}: {text}")
                    self.on_failure(errors[-1])
                    continue
                self._places += [(number, cloud) for cloud in range(count)]
            if not self._places:
                raise ScanError(errors[0] if len(errors) == 1 else f"none of the files can be read; {errors[0]}")
        return self._places

    def __len__(self) -> int:
        return len(self.places)

    def scan(self, index: int) -> tuple[Scan, str]:
        """The cloud of an index, with its file's suffix."""
        group, cloud = self.places[index]
        return self._read(group)[cloud], self.groups[group].suffix

    def readable_groups(self) -> list[CloudGroup]:
        """The groups that can be read, which keep what was read last."""
        numbers = dict.fromkeys(group for group, _ in self.places)
        return [replace(self.groups[number], read=lambda number=number: self._read(number))  # type: ignore[misc]
                for number in numbers]  # fmt: skip

    def scans(self) -> Iterable[tuple[Scan, str]]:
        """All clouds in order, each with its file's suffix."""
        return map(self.scan, range(len(self)))

    def _read(self, group: int) -> Sequence[Scan]:
        if group not in self._recent:
            clouds = self.groups[group].read()
            self._recent = dict([*self._recent.items()][-1:])
            self._recent[group] = clouds
        return self._recent[group]


def series_of_files(
    files: Iterable[Path], columns: tuple[str, ...] | None, options: ColorOptions,
    on_failure: Callable[[str], None] = lambda line: None,
) -> CloudSeries:  # fmt: skip
    """The series of the clouds of files; a file that holds several stands for several steps of the film."""

    def read(file: Path) -> list[Scan]:
        clouds = read_scans(file, columns, options)
        for cloud in clouds:
            if isinstance(cloud, ScanError):
                raise cloud
        return [cloud for cloud in clouds if isinstance(cloud, Scan)]

    groups = [CloudGroup(printable(file), format_suffix(file), lambda file=file: read(file))  # type: ignore[misc]
              for file in files]  # fmt: skip
    return CloudSeries(groups, on_failure)


def series_of_scans(scans: Sequence[Scan], suffix: str = "") -> CloudSeries:
    """The series of scans that are in memory; `suffix` is their file's."""
    return CloudSeries([CloudGroup("", suffix, lambda: scans)])


def natural_order(files: Iterable[Path]) -> list[Path]:
    """Files sorted by their names, in which numbers count as such: ``step_2`` comes before ``step_10``."""

    def key(file: Path) -> list[tuple[bool, int, str]]:
        parts = re.split(r"(\d+)", file.as_posix())
        return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]

    return sorted(files, key=key)


def have_matching_points(first: Scan, second: Scan) -> bool:
    """Whether two clouds hold the same points in the same order, moved: an affine map explains most of the motion.

    A shuffled cloud, or one sampled anew, does not match even if it has as many points.
    """
    if len(first.points) != len(second.points) or len(first.points) < 8:
        return False
    rows = subsample_uniform(np.arange(len(first.points), dtype=np.float64)[:, None].repeat(3, 1), MAX_MATCHED_POINTS)
    chosen = rows[:, 0].astype(np.int64)
    before, after = (scan.points[chosen] - scan.points[chosen].mean(0) for scan in (first, second))
    scale = np.abs(before).max() or 1.0
    solution = np.linalg.lstsq(before / scale, after / scale, rcond=None)[0]
    rest = after / scale - (before / scale) @ solution
    total = float(((after / scale) ** 2).sum())
    return total > 0 and 1 - float((rest**2).sum()) / total >= MIN_EXPLAINED_SHARE


def between(first: Scan, second: Scan, share: float) -> Scan:
    """The cloud at a share from 0 to 1 of the way between two whose points match; colors and scalars move too.

    Labels, and fields that only one of them has, are those of the nearer cloud.
    """
    nearer = first if share < 0.5 else second
    points = (1 - share) * first.points + share * second.points
    return replace(nearer, points=points, fields=_fields_between(first, second, nearer, share))


def _fields_between(first: Scan, second: Scan, nearer: Scan, share: float) -> PointFields | None:
    before, after, fields = first.fields, second.fields, nearer.fields
    if before is None or after is None or fields is None or len(before.points) != len(after.points):
        return fields
    values = dict(fields.values)
    for name in values:
        one, other = before.values.get(name), after.values.get(name)
        if one is None or other is None or one.shape != other.shape or one.dtype.kind != "f":
            continue
        values[name] = ((1 - share) * one + share * other).astype(one.dtype)
    return replace(fields, points=(1 - share) * before.points + share * after.points, values=values)
