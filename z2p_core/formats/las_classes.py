"""What the numbers of a LAS point's classification stand for."""

from __future__ import annotations

LAS_CLASS_NAMES: dict[int, str] = {
    0: "never classified",
    1: "unclassified",
    2: "ground",
    3: "low vegetation",
    4: "medium vegetation",
    5: "high vegetation",
    6: "building",
    7: "low point (noise)",
    8: "model key point",
    9: "water",
    10: "rail",
    11: "road surface",
    12: "overlap",
    13: "wire guard (shield)",
    14: "wire conductor (phase)",
    15: "transmission tower",
    16: "wire connector (insulator)",
    17: "bridge deck",
    18: "high noise",
    19: "overhead structure",
    20: "ignored ground",
    21: "snow",
    22: "temporal exclusion",
}
"""ASPRS's standard classes of LAS 1.4 (R15); 8 and 12 are reserved there and have their meaning of LAS 1.1 to 1.3.

Point formats 0 to 5 have no class above 31; from 64 on the numbers of formats 6 to 10 are the producer's own.
"""
