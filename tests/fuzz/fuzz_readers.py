"""Scans of all formats, sound and damaged: each is read, or refused in one line that says what is wrong."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path

import numpy as np
from changed_bytes import changed, grafted
from changed_values import changed as changed_value
from changed_values import json_text
from made_scans import MADE, Files, glb, gltf, gltf_tree, made, npz

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import Scan, read_each, readable_suffixes
from z2p_renderer.storage.scans.content_detection import is_prose, is_unrelated_bin

CASE = "case.json"
COLUMNS = (
    ["x", "y", "z"],
    ["x", "y", "z", "i"],
    ["i", "x", "y", "z"],
    ["z", "y", "x", "r", "g", "b"],
    ["x", "y", "z", "", ""],
)
LONGEST_MESSAGE = 1200
"""Characters, the path's among them."""
_PAGE, _CHECKED = 1024, 1020
"""Bytes of an E57 file's page, and how many of them the checksum in the others is of."""


def make(rng: np.random.Generator, folder: Path) -> None:
    """A scan in the folder, one in ten of which is sound."""
    suffix = str(rng.choice(sorted(readable_suffixes() if rng.random() < 0.93 else MADE)))
    files = _files(suffix, rng)
    scan = next(iter(files))
    if rng.random() < 0.06:  # under the name of another format
        renamed = f"scan{rng.choice(sorted(MADE))}"
        files = {renamed: files.pop(scan), **files}
        scan = renamed
    if rng.random() < 0.05:
        files = {f"{scan}.gz": _zipped(files.pop(scan), rng), **files}
        scan = f"{scan}.gz"
    for name, blob in files.items():
        (folder / name).write_bytes(blob)
    columns = COLUMNS[rng.integers(len(COLUMNS))] if rng.random() < 0.1 else None
    (folder / CASE).write_text(json.dumps({"scan": scan, "columns": columns}))


def check(folder: Path) -> str:
    """``read`` or ``refused``, with the suffix.

    Raises:
        AssertionError: what came of the scan is neither points nor a good message.
    """
    case = json.loads((folder / CASE).read_text())
    path = folder / case["scan"]
    suffix = "".join(path.suffixes[-2:])
    is_prose(path)
    is_unrelated_bin(path)
    try:
        scans = read_each(path, tuple(case["columns"]) if case["columns"] else None)
    except ScanError as error:
        _check_message(error, path)
        return f"refused {suffix}"
    assert scans, "neither a cloud nor an error"
    for scan in scans:
        _check_message(scan, path) if isinstance(scan, ScanError) else _check_scan(scan)
    return f"read {suffix}" if any(isinstance(scan, Scan) for scan in scans) else f"refused {suffix}"


def unmade() -> set[str]:
    """Suffixes that are read, and of which no scan is made here."""
    return set(readable_suffixes()) - set(MADE)


def _files(suffix: str, rng: np.random.Generator) -> Files:
    """A scan of that suffix and what lies beside it, changed in most cases, inside of what packs it for some."""
    if rng.random() < 0.1:
        return made(suffix, rng)
    if suffix == ".npz" and rng.random() < 0.7:
        return {"scan.npz": npz(rng, lambda blob: changed(blob, rng))}
    if suffix in (".glb", ".gltf") and rng.random() < 0.7:
        tree, binary = gltf_tree(rng)
        text = json_text(changed_value(tree, rng))
        return {"scan.glb": glb(text, binary)} if suffix == ".glb" else gltf(tree, text, binary, rng)
    files = made(suffix, rng)
    other = next(iter(made(str(rng.choice(sorted(MADE))), rng).values())) if rng.random() < 0.2 else b""
    scan, *companions = files
    target = companions[rng.integers(len(companions))] if companions and rng.random() < 0.3 else scan
    files[target] = grafted(files[target], other, rng) if other else changed(files[target], rng, [files[scan]])
    if suffix == ".e57" and rng.random() < 0.8:
        files[scan] = _with_checksums(files[scan])
    return files


def _zipped(blob: bytes, rng: np.random.Generator) -> bytes:
    packed = gzip.compress(blob, 1, mtime=0)
    return changed(packed, rng) if rng.random() < 0.4 else packed


def _with_checksums(blob: bytes) -> bytes:
    """An E57 file whose pages are right again, so that what is in them is looked at."""
    pages = [blob[at : at + _CHECKED].ljust(_CHECKED, b"\0") for at in range(0, len(blob), _PAGE)]
    return b"".join(page + struct.pack(">I", _crc32c(page)) for page in pages)


def _crc32c(page: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in page:
        crc = _CRC[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF


def _crc_table() -> list[int]:
    table = []
    for number in range(256):
        for _ in range(8):
            number = (number >> 1) ^ (0x82F63B78 if number & 1 else 0)
        table.append(number)
    return table


_CRC = _crc_table()


def _check_message(error: ScanError, path: Path) -> None:
    text = str(error)
    assert "\n" not in text and text.isprintable(), f"a message of several lines or signs: {text!r}"
    assert str(path) in text, f"a message that names no file: {text!r}"
    assert len(text) < LONGEST_MESSAGE + len(str(path)), f"a message of {len(text)} characters: {text[:200]}"
    assert "' failed (" not in text, f"a reader that fails in its own way: {text}"  # `storage.scans.clouds` words it so


def _check_scan(scan: Scan) -> None:
    points = scan.points
    assert points.dtype == np.float64 and points.ndim == 2 and points.shape[1] == 3, (points.dtype, points.shape)
    assert len(points) and np.isfinite(points).all() and (points != points[0]).any()
    assert scan.dropped >= 0 and scan.repeated >= 0 and (scan.total is None or scan.total >= 0), scan
    for text in (scan.note, scan.up_reason):
        assert "\n" not in text and len(text) < LONGEST_MESSAGE, f"a note that is no line: {text[:200]!r}"
    assert scan.up in ("", "+X", "-X", "+Y", "-Y", "+Z", "-Z"), scan.up
    if scan.sensor is not None:
        assert np.isfinite(scan.sensor.position).all(), scan.sensor
        turn = scan.sensor.rotation
        assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-4), f"a sensor whose axes are none: {turn.tolist()}"
