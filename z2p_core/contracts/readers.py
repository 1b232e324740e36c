"""Checks of `Reader` plugins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.contracts.assertions import check_array, check_class, expect, refuses, same
from z2p_core.interfaces import RawCloud, Reader, ScanError, Sensor


def check_reader(reader_class: type[Reader], example_file: Path, broken_file: Path | None = None) -> None:
    """None when the class keeps what `Reader` promises on an example file, and refuses a broken one with ScanError.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("readers", reader_class, Reader)
    reader, name = reader_class(), reader_class.name
    expect(bool(reader.suffixes), f"{name}: suffixes is empty")
    for suffix in reader.suffixes:
        proper = suffix.startswith(".") and suffix == suffix.lower()
        expect(proper, f"{name}: expected a lower-case suffix with its dot, as '.ply', got {suffix!r}")
    found = example_file.suffix.lower()
    expect(found in reader.suffixes, f"{name}: {found!r} of the example file is none of {', '.join(reader.suffixes)}")
    clouds = reader.read(example_file)
    expect(isinstance(clouds, list) and len(clouds) > 0, f"{name}: expected a list of clouds, got {clouds!r}")
    for cloud, again in zip(map(_raw, clouds), map(_raw, reader.read(example_file)), strict=True):
        check_array(cloud.points, (len(cloud.points), 3), np.float64, f"{name}: read", finite=False)
        expect(len(cloud.points) > 0, f"{name}: read gives no point of the example file")
        same(again.points, cloud.points, f"{name}: the same file read twice")
        if cloud.sensor is not None:
            _check_sensor(cloud.sensor, name)
    _check_fields(reader, example_file)
    if broken_file is not None:
        refuses(lambda: reader.read(broken_file), ScanError, f"{name}: read of the broken {broken_file.name}")


def _check_fields(reader: Reader, example_file: Path) -> None:
    """Checks the fields of the example file: all of them, the same twice, and none at all."""
    name, usual = reader.name, reader.wanted
    try:
        reader.wanted = None
        whole, again = (list(map(_raw, reader.read(example_file))) for _ in range(2))
        reader.wanted = ()
        bare = list(map(_raw, reader.read(example_file)))
    finally:
        reader.wanted = usual
    expect(len(whole) == len(again) == len(bare), f"{name}: the number of clouds depends on the fields that are wanted")
    for cloud, twin, plain in zip(whole, again, bare, strict=True):
        same(plain.points, cloud.points, f"{name}: the points without and with fields")
        expect(set(twin.fields) == set(cloud.fields), f"{name}: the same file read twice has other fields")
        for field, values in cloud.fields.items():
            _check_field(field, values, len(cloud.points), name)
            same(twin.fields[field], values, f"{name}: the field {field!r} of the same file read twice")
        listed = set(cloud.field_names) or set(cloud.fields)
        expect(set(cloud.fields) == listed, f"{name}: field_names lists {', '.join(map(repr, sorted(listed)))}, and "
               f"wanted = None gives {', '.join(map(repr, sorted(cloud.fields)))}")  # fmt: skip
        known = f"{name}: class_names and units are of fields that the file has, got"
        expect(set(cloud.units) <= listed, f"{known} units of {', '.join(map(repr, sorted(cloud.units)))}")


def _check_field(field: str, values: Any, count: int, name: str) -> None:
    """Checks the shape and type of a field, and the range of colors."""
    where = f"{name}: the field {field!r}"
    expect(isinstance(values, np.ndarray) and values.dtype.kind in "fiu", f"{where} is no array of numbers")
    shape = (count, 3) if field in ("rgb", "normal") else (count,)
    expect(values.shape == shape, f"{where} has the shape {values.shape}, expected {shape}")
    if field in ("rgb", "normal"):
        expect(values.dtype.kind == "f", f"{where} is {values.dtype}, expected floats")
    if field == "rgb":
        known = values[np.isfinite(values)]
        inside = known.size == 0 or bool(known.min() >= 0 and known.max() <= 1)
        expect(inside and not np.isinf(values).any(), f"{where} leaves [0, 1]")


def _raw(cloud: Any) -> RawCloud:
    return cloud if isinstance(cloud, RawCloud) else RawCloud(cloud)


def _check_sensor(sensor: Sensor, name: str) -> None:
    check_array(sensor.position, (3,), np.float64, f"{name}: the sensor's position")
    check_array(sensor.rotation, (3, 3), np.float64, f"{name}: the sensor's rotation")
    proper = np.allclose(sensor.rotation @ sensor.rotation.T, np.eye(3), atol=1e-6)
    expect(proper and np.linalg.det(sensor.rotation) > 0, f"{name}: the sensor's rotation is none: {sensor.rotation}")
