"""Finds a scan's fields by name, and keeps the points of some classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from z2p_core.coloring.options import CLASS_FIELDS, NONE, RGB, ColorOptions
from z2p_core.errors.did_you_mean import closest_name
from z2p_core.formats.field_names import field_key
from z2p_core.formats.las_classes import LAS_CLASS_NAMES
from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import MIN_POINTS, PointFields, Scan, read_each
from z2p_renderer.storage.scans.duplicate_points import drop_duplicates

VECTOR_FIELDS = (RGB, "normal")
"""Fields that are no scalars."""
COORDINATES = ("x", "y", "z")
HEIGHT = "height"
"""Name of the field that every placed cloud has: height above its lowest point, in the data's units."""
LABEL_WORDS = ("class", "label", "segment", "instance", "cluster", "object", "category", "semantic", "part", "index",
               "returnnumber", "numberofreturns", "id")  # fmt: skip
"""Words in the names of fields whose whole numbers are labels, however many there are."""
MEASUREMENT_WORDS = ("intensity", "time", "height", "elevation", "depth", "angle", "distance", "range", "error",
                     "confidence", "curvature", "temperature", "reflect", "amplitude", "density")  # fmt: skip
"""Words in the names of fields whose whole numbers are measurements, however few there are."""
MAX_LABELS = 20
"""Up to so many different whole numbers are labels, whatever else their field's name is."""
MAX_LISTED_CLASSES = 12
"""How many classes a message lists."""


@dataclass(frozen=True)
class ScalarField:
    """One value for each of some points."""

    name: str
    points: np.ndarray
    """(K, 3) float64, in the scan's units and axes."""
    values: np.ndarray
    """(K,) of any numeric type."""
    unit: str = ""
    class_names: Mapping[int, str] = field(default_factory=dict)

    @property
    def is_categorical(self) -> bool:
        """Whether the values are labels rather than measurements."""
        if self.values.dtype.kind == "b" or self.class_names:
            return True
        key = field_key(self.name)
        labeled = any(word in key for word in LABEL_WORDS)
        if self.values.dtype.kind == "f":
            known = self.values[np.isfinite(self.values)]
            return labeled and len(known) > 0 and bool((known == np.rint(known)).all())
        measured = any(word in key for word in MEASUREMENT_WORDS)
        return labeled or (not measured and len(np.unique(self.values)) <= MAX_LABELS)


def read_scans(
    path: Path, columns: tuple[str, ...] | None, options: ColorOptions, max_rows: int | None = None
) -> list[Scan | ScanError]:
    """All clouds of a file, as `read_each` reads them, with the fields and points that the options ask for.

    Of a large file `max_rows` points are kept.

    Raises:
        ScanError: the file as a whole cannot be read.
    """
    clouds = read_each(path, columns, options.wanted_fields, max_rows)
    if not options.classes:
        return clouds
    kept: list[Scan | ScanError] = []
    for cloud in clouds:
        try:
            kept.append(keep_classes(cloud, options) if isinstance(cloud, Scan) else cloud)
        except ScanError as error:
            kept.append(ScanError(f"{cloud.label}: {error}" if isinstance(cloud, Scan) and cloud.label else str(error)))
    return kept


def has_own_colors(scan: Scan) -> bool:
    """Whether the scan has a color of its own for some point."""
    srgb = None if scan.fields is None else scan.fields.values.get(RGB)
    return srgb is not None and bool(np.isfinite(srgb).all(axis=1).any())


def find_scalars(scan: Scan, name: str, purpose: str = "color by") -> ScalarField:
    """The field of that name of a scan, for that purpose; its coordinates x, y and z are fields as well.

    Raises:
        ScanError: it has none of that name, or not one number for each point.
    """
    fields = scan.fields or PointFields(scan.points)
    key = field_key(name)
    match = next((known for known in fields.values if field_key(known) == key), None)
    if match is not None and fields.values[match].ndim == 1:
        return ScalarField(match, fields.points, fields.values[match], fields.units.get(match, ""),
                           class_names_of(match, fields))  # fmt: skip
    if match is None and key in COORDINATES:
        return ScalarField(key, scan.points, scan.points[:, COORDINATES.index(key)])
    raise ScanError(_no_such_field(name, fields, purpose))


def class_names_of(name: str, fields: PointFields) -> Mapping[int, str]:
    """What the values of a field stand for; a classification's without names of its own are those of LAS files."""
    if name in fields.class_names:
        return fields.class_names[name]
    return LAS_CLASS_NAMES if field_key(name) == "classification" else {}


def keep_classes(scan: Scan, options: ColorOptions) -> Scan:
    """The scan with only the points of the classes that the options name.

    Raises:
        ScanError: it has no field of classes, or too few points of these.
    """
    labels = _class_field(scan, options)
    kept = np.isin(labels.values, options.classes)
    if kept.sum() < MIN_POINTS:
        there = ", ".join(f"{value:g}" for value in np.unique(labels.values)[:MAX_LISTED_CLASSES].tolist())
        raise ScanError(f"expected points of the classes {', '.join(map(str, options.classes))} in the field "
                        f"{labels.name!r}, got {int(kept.sum())}; its classes are {there}")
    assert scan.fields is not None
    values = {name: values[kept] for name, values in scan.fields.values.items()}
    fields = replace(scan.fields, points=scan.fields.points[kept], values=values)
    left_out = f"{int((~kept).sum())} points of other classes left out ({labels.name})"
    return replace(scan, points=drop_duplicates(fields.points), fields=fields,
                   note="; ".join(filter(None, [scan.note, left_out])))  # fmt: skip


def _class_field(scan: Scan, options: ColorOptions) -> ScalarField:
    """The field by which classes are kept: that of the colors if its values are labels, else one of the usual names."""
    names = [options.field] if options.field is not None else []
    for name in (*names, *CLASS_FIELDS):
        try:
            labels = find_scalars(scan, name)
        except ScanError:
            continue
        if scan.fields is not None and len(labels.points) == len(scan.fields.points) and labels.is_categorical:
            return labels
    known = ", ".join(scan.fields.names) if scan.fields is not None and scan.fields.names else "none"
    raise ScanError(f"expected a field of classes to keep some of, such as classification or label, got the fields "
                    f"{known}; name it with --color-by, or leave --classes out")


def _no_such_field(name: str, fields: PointFields, purpose: str) -> str:
    known = [one for one in fields.names if one not in VECTOR_FIELDS]
    listed = ", ".join([*([RGB] if RGB in fields.names else []), *known, *COORDINATES, HEIGHT, NONE])
    near = closest_name(name, [*known, HEIGHT])
    guess = "" if near is None else f" (did you mean {near}?)"
    return f"expected to {purpose} one of its fields {listed}, got {name!r}{guess}"
