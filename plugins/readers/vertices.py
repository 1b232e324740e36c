"""Vertices of OBJ and OFF files, also those that no face uses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from z2p_core.interfaces import MEMORY_A_CHARACTER, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.point_fields import FieldPlan, Wants, plan_fields

_OFF_HEADER = re.compile(
    rb"(?P<texture>ST)?(?P<colours>C)?(?P<normals>N)?(?P<homogeneous>4)?(?P<dimensions>n)?OFF(?![A-Za-z])(?P<counts>.*)"
)
"""The first line of an OFF file; some writers put the counts on it too."""
_COLORED_VERTEX_WORDS = 7
"""Least number of words on an OBJ line ``v x y z r g b``; an opacity may follow."""


class Vertices(Reader):
    """Wavefront OBJ and OFF (4OFF, COFF, NOFF, STOFF too); faces and textures are left out."""

    name = "vertices"
    version = "3"
    takes_columns = False
    suffixes = (".obj", ".off")

    def memory(self, path: Path) -> int:
        """Text is read as a whole."""
        return MEMORY_A_CHARACTER * path.stat().st_size

    def read(self, path: Path) -> list[RawCloud]:
        """The file's vertices, one cloud (N, 3) float64.

        Raises:
            ScanError: no file of its format, or not the vertices that its first line promises (OFF).
        """
        blob = path.read_bytes()
        return [(_read_obj if path.suffix.lower() == ".obj" else _read_off)(blob, self.wants)]


def _read_obj(blob: bytes, wants: Wants) -> RawCloud:
    """Points of the ``v`` lines; trimesh would drop vertices without a face and duplicate those on texture seams."""
    whole = blob.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")  # a line goes on after a backslash
    lines = [line.split() for line in whole.splitlines() if line.lstrip()[:2] in (b"v ", b"v\t")]
    rows = [words[1:4] for words in lines]
    if not rows and blob.strip():
        raise ScanError("expected OBJ vertices (lines 'v x y z'), found none; this is another format under that name, "
                        "or it holds no points")
    try:
        cloud = RawCloud(np.array(rows, dtype=np.float64).reshape(len(rows), 3))
        if not lines or max(map(len, lines)) < _COLORED_VERTEX_WORDS:
            return cloud
        plan = plan_fields(["x", "y", "z", "r", "g", "b"], wants, (0, 1, 2))
        none = [b"nan"] * 3
        colors = np.array([line[4:7] if len(line) >= _COLORED_VERTEX_WORDS else none for line in lines],
                          dtype=np.float64) if plan.needed else np.empty((len(lines), 3))  # fmt: skip
        return plan.fill(cloud, dict(zip((3, 4, 5), colors.T, strict=True)))
    except ValueError as error:
        raise ScanError(f"expected three numbers on each OBJ line 'v x y z': {_short_reason(error)}; "
                        "export it again") from error


def _read_off(blob: bytes, wants: Wants) -> RawCloud:
    """Points of an OFF file; normals, colors or texture coordinates may follow each point, as the first word says."""
    lines = [line for line in (line.split(b"#", 1)[0].strip() for line in blob.splitlines()) if line]
    header = _OFF_HEADER.match(lines[0]) if lines else None
    if header is None:
        raise ScanError("expected an OFF file, which begins with 'OFF'; this is another format under that name")
    if b"BINARY" in lines[0]:
        raise ScanError("binary OFF files are not read; export the mesh in text, or as PLY")
    if header["dimensions"]:
        raise ScanError("an OFF file of other than three dimensions (nOFF) shows no surface; export the mesh as OFF")
    rest = [header["counts"], *lines[1:]] if header["counts"].strip() else lines[1:]
    try:
        count, faces = (int(word) for word in rest[0].split()[:2])
        rows = rest[1 : count + 1]
        if min(count, faces) < 0 or len(rest) - 1 < count + faces:
            raise ValueError(f"{count} vertices and {faces} faces promised, {len(rest) - 1} lines came")
        width = 4 if header["homogeneous"] else 3
        plan, columns = _plan_off(header, rows, wants)
        words = [row.split() for row in rows]
        numbers = np.array([row[:width] for row in words], dtype=np.float64).reshape(count, width)
        values = {column: np.array([row[column] for row in words], dtype=np.float64) for column in columns}
    except (ValueError, IndexError) as error:
        raise ScanError(f"the OFF vertices cannot be read ({_short_reason(error)}); export the file again") from error
    with np.errstate(all="ignore"):  # a place at infinity is left out like any that is not finite
        points = numbers[:, :3] / numbers[:, 3:] if width == 4 else numbers
    return plan.fill(RawCloud(points), values)


def _plan_off(header: re.Match[bytes], rows: list[bytes], wants: Wants) -> tuple[FieldPlan, tuple[int, ...]]:
    """The fields of an OFF file, and their columns: its first word tells which follow x, y and z, in a fixed order."""
    names = ["x", "y", "z", *(["w"] if header["homogeneous"] else [])]
    points = range(len(names))
    names += ["nx", "ny", "nz"] if header["normals"] else []
    width = min((len(row.split()) for row in rows), default=0)
    channels = width - len(names) - (2 if header["texture"] else 0)
    names += ["r", "g", "b", "alpha"][: min(channels, 4)] if header["colours"] and channels >= 3 else []
    plan = plan_fields(names if width >= len(names) else names[: len(points)], wants, points)
    return plan, plan.columns


def _short_reason(error: Exception) -> str:
    return str(error).partition("\n")[0][:160]
