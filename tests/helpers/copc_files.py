"""A small COPC file: LAZ whose chunks are the nodes of an octree, which a table at the end tells."""

from __future__ import annotations

import io
import struct

import laspy
import lazrs
import numpy as np


def copc(points: np.ndarray, levels: int = 2) -> bytes:
    """Points (N, 3), dealt out to nodes: the first of each ten to the root, the others to its children by octant."""
    scale, low = 0.001, points.min(0)
    half = float(np.ptp(points, axis=0).max()) / 2
    centre = low + half
    octant = (points > centre) @ np.array([1, 2, 4])
    root = np.arange(len(points)) % 10 == 0
    nodes = [((0, 0, 0, 0), np.flatnonzero(root))]
    nodes += [((1, number & 1, number >> 1 & 1, number >> 2), np.flatnonzero(~root & (octant == number)))
              for number in range(8) if levels > 1 and (~root & (octant == number)).any()]  # fmt: skip
    packing = lazrs.LazVlr.new_for_compression(6, 0, use_variable_size_chunks=True)
    stream = io.BytesIO()
    compressor = lazrs.LasZipCompressor(stream, packing)
    ends = []
    for _, rows in nodes:
        record = laspy.ScaleAwarePointRecord.zeros(
            len(rows), point_format=laspy.PointFormat(6), scales=np.full(3, scale), offsets=low)
        record.x, record.y, record.z = points[rows].T
        compressor.compress_many(np.frombuffer(record.array.tobytes(), np.uint8))
        compressor.finish_current_chunk()
        ends.append(stream.tell())
    compressor.done()
    laszip = packing.record_data()
    start = 375 + 54 + 160 + 54 + len(laszip)
    begins = [8, *ends[:-1]]
    table = b"".join(struct.pack("<4iQii", *key, start + begin, end - begin, len(rows))
                     for (key, rows), begin, end in zip(nodes, begins, ends, strict=True))  # fmt: skip
    body = bytearray(stream.getvalue())
    body[:8] = struct.pack("<q", start + struct.unpack("<q", body[:8])[0])
    at = start + len(body)
    info = struct.pack("<5d2Q2d88x", *centre, half, half / 100, at + 60, len(table), 0, 1)
    count = sum(len(rows) for _, rows in nodes)
    head = struct.pack("<4sHH16sBB32s32sHHHIIBHI5I", b"LASF", 0, 16, bytes(16), 1, 4, b"", b"", 1, 2026, 375, start, 2,
                       6 | 128, 30, 0, 0, 0, 0, 0, 0)  # fmt: skip
    high = points.max(0)
    box = (high[0], low[0], high[1], low[1], high[2], low[2])
    head += struct.pack("<12d", *[scale] * 3, *low, *box) + struct.pack("<QQIQ15Q", 0, at, 1, count, count, *[0] * 14)
    records = struct.pack("<H16sHH32s", 0, b"copc", 1, 160, b"") + info
    records += struct.pack("<H16sHH32s", 0, b"laszip encoded", 22204, len(laszip), b"") + laszip
    tail = struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(table), b"") + table
    return head + records + bytes(body) + tail
