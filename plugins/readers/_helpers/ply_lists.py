"""PLY vertices with lists before or among their properties, so that rows differ in length."""

from __future__ import annotations

import numpy as np

from z2p_core.formats.ply_header import PlyElement, PlyHeader
from z2p_core.interfaces import ScanError
from z2p_core.native import read_list_rows


def parse_binary_lists(body: bytes, header: PlyHeader, vertex: PlyElement, columns: tuple[str, ...]) -> np.ndarray:
    """Numbers (N, len(columns)) float64 of the vertices, from all bytes behind the header.

    Raises:
        ScanError: a list reaches past the file's end.
    """
    offset = 0
    for element in header.elements[: header.elements.index(vertex) + 1]:
        indices = _property_indices(vertex, columns) if element is vertex else []
        properties = [(entry.type, entry.length) for entry in element.properties]
        try:
            values, offset = read_list_rows(body, offset, element.count, properties, indices)
        except ValueError as error:
            raise ScanError("a PLY list reaches past the end of the file; it is cut short or its header is wrong: "
                            "export it again") from error
    return values


def parse_ascii_lists(lines: list[bytes], vertex: PlyElement, columns: tuple[str, ...]) -> np.ndarray:
    """Numbers (N, len(columns)) float64 of the vertices, a line each.

    Raises:
        ValueError: a line with more or fewer numbers than it should have, or with something else.
    """
    indices = _property_indices(vertex, columns)
    values = np.empty((len(lines), len(indices)))
    for row, line in enumerate(lines):
        words = line.split()
        at, starts = 0, []
        for entry in vertex.properties:
            starts.append(at)
            at += 1 + (int(words[at]) if entry.length is not None and at < len(words) else 0)
        if at != len(words):
            raise ValueError(f"vertex {row + 1}: {at} numbers expected, {len(words)} came")
        values[row] = [float(words[starts[index]]) for index in indices]
    return values


def _property_indices(vertex: PlyElement, wanted: tuple[str, ...]) -> list[int]:
    """Indices of the properties with these names."""
    names = [None if entry.length is not None else entry.name for entry in vertex.properties]
    return [names.index(name) for name in wanted]
