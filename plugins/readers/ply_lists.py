"""PLY vertices that lists stand before or among, so that their rows have to be walked."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import ScanError
from z2p_core.ply_header import PlyElement, PlyHeader


def walked_binary(body: bytes, header: PlyHeader, vertex: PlyElement, axes: tuple[str, ...]) -> np.ndarray:
    """x, y and z (N, 3) float64 of the vertices, from all bytes behind the header.

    Raises:
        ScanError: a list reaches past the file's end.
    """
    offset = 0
    for element in header.elements[: header.elements.index(vertex) + 1]:
        places = _places(vertex, axes) if element is vertex else []
        try:
            values, offset = _even_rows(body, element, places, offset) or _uneven_rows(body, element, places, offset)
        except ValueError as error:
            raise ScanError("a PLY list reaches past the end of the file; it is cut short or its header is wrong: "
                            "export it again") from error
    return values


def walked_ascii(lines: list[bytes], vertex: PlyElement, axes: tuple[str, ...]) -> np.ndarray:
    """x, y and z (N, 3) float64 of the vertices, a line each.

    Raises:
        ValueError: a line with more or fewer numbers than it should have, or with something else.
    """
    places = _places(vertex, axes)
    values = np.empty((len(lines), len(places)))
    for row, line in enumerate(lines):
        words = line.split()
        at, starts = 0, []
        for entry in vertex.properties:
            starts.append(at)
            at += 1 + (int(words[at]) if entry.length is not None and at < len(words) else 0)
        if at != len(words):
            raise ValueError(f"vertex {row + 1}: {at} numbers expected, {len(words)} came")
        values[row] = [float(words[starts[place]]) for place in places]
    return values


def _places(vertex: PlyElement, axes: tuple[str, ...]) -> list[int]:
    """Indices of the properties of those names."""
    names = [None if entry.length is not None else entry.name for entry in vertex.properties]
    return [names.index(axis) for axis in axes]


def _even_rows(body: bytes, element: PlyElement, places: list[int], offset: int) -> tuple[np.ndarray, int] | None:
    """As `_uneven_rows`, at once; None where lists have other lengths than in the first row."""
    fields: list[tuple[str, np.dtype, tuple[int, ...]]] = []
    lengths: dict[str, int] = {}
    at = offset
    for index, entry in enumerate(element.properties if element.count else ()):
        count = 1
        if entry.length is not None:
            count = _length(body, entry.length, at)
            lengths[f"length {index}"] = count
            fields.append((f"length {index}", entry.length, ()))
            at += entry.length.itemsize
        fields.append((str(index), entry.type, () if entry.length is None else (count,)))
        at += count * entry.type.itemsize
        if at > len(body):
            raise ValueError(at)
    end = offset + element.count * (at - offset)
    if end > len(body):
        return None
    rows: np.ndarray = np.frombuffer(body, np.dtype(fields), element.count, offset) if fields else np.empty(0)
    if any((rows[name] != length).any() for name, length in lengths.items()):
        return None
    columns = [rows[str(place)].astype(np.float64) for place in places]
    return np.column_stack(columns) if columns else np.empty((0, 0)), end


def _uneven_rows(body: bytes, element: PlyElement, places: list[int], offset: int) -> tuple[np.ndarray, int]:
    """Values (N, len(places)) float64 of an element's rows from `offset` on, and where they end.

    Raises:
        ValueError: they reach past the end.
    """
    values = np.empty((element.count, len(places)))
    for row in range(element.count):
        for index, entry in enumerate(element.properties):
            count = 1
            if entry.length is not None:
                count = _length(body, entry.length, offset)
                offset += entry.length.itemsize
            elif index in places:
                values[row, places.index(index)] = np.frombuffer(body, entry.type, 1, offset)[0]
            offset += count * entry.type.itemsize
    if offset > len(body):
        raise ValueError(offset)
    return values, offset


def _length(body: bytes, kind: np.dtype, offset: int) -> int:
    length = int(np.frombuffer(body, kind, 1, offset)[0])
    if length < 0:
        raise ValueError(length)
    return length
