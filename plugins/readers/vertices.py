"""Vertices of OBJ and OFF files, also those that no face uses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from z2p_core.interfaces import MEMORY_A_CHARACTER, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.color_note import IGNORED_NOTE

_OFF_HEADER = re.compile(
    rb"(?P<texture>ST)?(?P<colours>C)?(?P<normals>N)?(?P<homogeneous>4)?(?P<dimensions>n)?OFF(?![A-Za-z])(?P<counts>.*)"
)
"""The first line of an OFF file; some writers put the counts on it too."""
_COLORED_VERTEX_WORDS = (7, 8)
"""Number of words on an OBJ line ``v x y z r g b``, and with an opacity."""


class Vertices(Reader):
    """Wavefront OBJ and OFF (4OFF, COFF, NOFF, STOFF too); faces, textures and colours are left out."""

    name = "vertices"
    version = "2"
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
        return [_read_obj(blob) if path.suffix.lower() == ".obj" else _read_off(blob)]


def _read_obj(blob: bytes) -> RawCloud:
    """Points of the ``v`` lines; trimesh would drop vertices without a face and duplicate those on texture seams."""
    whole = blob.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")  # a line goes on after a backslash
    lines = [line.split() for line in whole.splitlines() if line.lstrip()[:2] in (b"v ", b"v\t")]
    rows = [words[1:4] for words in lines]
    if not rows and blob.strip():
        raise ScanError("expected OBJ vertices (lines 'v x y z'), found none; this is another format under that name, "
                        "or it holds no points")
    note = IGNORED_NOTE if lines and len(lines[0]) in _COLORED_VERTEX_WORDS else ""
    try:
        return RawCloud(np.array(rows, dtype=np.float64).reshape(len(rows), 3), note=note)
    except ValueError as error:
        raise ScanError(f"expected three numbers on each OBJ line 'v x y z': {_short_reason(error)}; "
                        "export it again") from error


def _read_off(blob: bytes) -> RawCloud:
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
        numbers = np.array([row.split()[:width] for row in rows], dtype=np.float64).reshape(count, width)
    except (ValueError, IndexError) as error:
        raise ScanError(f"the OFF vertices cannot be read ({_short_reason(error)}); export the file again") from error
    with np.errstate(all="ignore"):  # a place at infinity is left out like any that is not finite
        points = numbers[:, :3] / numbers[:, 3:] if width == 4 else numbers
    return RawCloud(points, note=IGNORED_NOTE if header["colours"] else "")


def _short_reason(error: Exception) -> str:
    return str(error).partition("\n")[0][:160]
