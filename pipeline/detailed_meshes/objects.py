"""Six objects with fine relief, each a closed mesh of about as many triangles as one asks for.

=========  ======================================================================================================
`tablet`   a stone slab with an inscription on both sides, its lines from large to barely legible
`vase`     a hollow vase with a meander, a ring of letters, flutes and fine cracks in the glaze
`scales`   a ring covered with overlapping scales
`cloth`    a cloth with folds, woven of threads
`bust`     a head with combed hair: locks, and strands in them
`coin`     a coin with letters around a rosette of hairlines, and a reeded edge
=========  ======================================================================================================
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from z2p_renderer.pipeline.detailed_meshes.grids import (
    closed_ball,
    closed_slab,
    closed_tube,
    displace,
    periodic_coordinates,
)
from z2p_renderer.pipeline.detailed_meshes.relief import (
    TURN,
    letters,
    scales,
    smooth_noise,
    strands,
    weathering,
    woven_threads,
)
from z2p_renderer.storage.meshes import write_mesh

DETAILED = "detailed"
"""What users call these meshes in place of a folder."""
FACES = 2_000_000
"""Triangles of each mesh, about."""
INSCRIPTION = (
    ("SHARP", 0.2), ("AS THE POINTS ALLOW", 0.105), ("SPHINX OF BLACK QUARTZ", 0.075),
    ("JUDGE MY VOW 0123456789", 0.055), ("PACK MY BOX WITH FIVE DOZEN JUGS", 0.042),
    ("THE FIVE BOXING WIZARDS JUMP QUICKLY", 0.032), ("HOW VEXINGLY QUICK DAFT ZEBRAS JUMP 31415926535", 0.025),
    ("WALTZ BAD NYMPH FOR QUICK JIGS VEX 27182818284", 0.019),
    ("GLIB JOCKS QUIZ NYMPH TO VEX DWARF 14142135623", 0.015),
)  # fmt: skip
"""Lines of the tablet, and the height of their capitals; the tablet is 1.7 units wide."""

Triangles = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) float64 and triangles (M, 3) int64."""


def make_detailed_meshes(folder: Path, names: tuple[str, ...] = (), faces: int = FACES) -> dict[str, Path]:
    """PLY files of the meshes in `folder`, by name; a file that is there already is kept.

    Raises:
        ValueError: no such mesh.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = {name: folder / f"{name}.ply" for name in names or DETAILED_MESHES}
    for name, path in paths.items():
        if not path.exists():
            unfinished = path.with_name(f".{name}.unfinished")
            write_mesh(unfinished, *detailed_mesh(name, faces))
            unfinished.replace(path)
    return paths


def detailed_mesh(name: str, faces: int = FACES) -> Triangles:
    """Vertices (V, 3) float64 and about `faces` triangles (M, 3) int64 of a detailed mesh, +Z up; always the same.

    Raises:
        ValueError: no such mesh.
    """
    if name not in DETAILED_MESHES:
        raise ValueError(f"unknown detailed mesh {name!r}; there are {', '.join(DETAILED_MESHES)}")
    return DETAILED_MESHES[name](faces, np.random.default_rng(list(DETAILED_MESHES).index(name)))


def tablet(faces: int, rng: np.random.Generator) -> Triangles:
    """A standing slab with rounded rims and an inscription cut into both sides."""
    width, height, depth, fillet = 1.7, 1.36, 0.2, 0.06
    columns, rows = _sides(faces / 2, width / height)
    x, z = np.meshgrid(np.linspace(-1, 1, columns) * width / 2, np.linspace(-1, 1, rows) * height / 2, indexing="ij")
    to_rim = np.minimum(width / 2 - np.abs(x), height / 2 - np.abs(z))
    rounding = fillet - np.sqrt(np.clip(fillet**2 - np.clip(fillet - to_rim, 0, None) ** 2, 0, None))
    ink = letters(INSCRIPTION, 1.5, 1.25, round(columns * 1.5 / width), round(rows * 1.25 / height))
    cut = np.zeros((columns, rows))
    left, bottom = (columns - ink.shape[0]) // 2, (rows - ink.shape[1]) // 2
    cut[left : left + ink.shape[0], bottom : bottom + ink.shape[1]] = ink
    side: list[np.ndarray] = []
    for _ in range(2):
        stone = 0.0035 * weathering(np.stack([x, np.full_like(x, len(side)), z], axis=-1), rng)
        side.append(depth / 2 - rounding + stone - 0.011 * cut)
    return closed_slab(np.stack([x, -side[0], z], axis=-1), np.stack([x, side[1][::-1], z], axis=-1))


def vase(faces: int, rng: np.random.Generator) -> Triangles:
    """A hollow vase: up the outside, over the lip, down the inside."""
    columns, rows = _sides(faces, 0.8)
    u, v = periodic_coordinates(columns, rows)
    share = np.interp(v, [0, 0.12, 0.72, 0.76, 0.96, 1], [0, 0, 1, 1, 0.06, 0.06])  # of the height
    outside = 0.34 + 0.26 * np.sin(4.6 * share + 0.2) * (1 - 0.35 * share)
    inset = 0.05 * np.interp(v, [0.72, 0.76], [0, 1])
    ring = np.interp(v, [0, 0.12, 0.96, 1], [0, 1, 1, 0]) * (outside - inset)
    points = np.stack(np.broadcast_arrays(ring * np.cos(TURN * u), ring * np.sin(TURN * u), 1.6 * share), axis=-1)
    outer = (v > 0.12) & (v < 0.72)
    flutes = 0.012 * np.abs(np.sin(np.pi * 36 * u)) * _band(share, 0.04, 0.3)
    meander = 0.014 * _meander(u * 40, (share - 0.4) / 0.1) * _band(share, 0.4, 0.5)
    text = np.zeros((columns, rows))
    inside = np.flatnonzero(outer[0] & (share[0] > 0.56) & (share[0] < 0.7))
    if len(inside):
        words = "A VESSEL OF CLAY TURNED BY HAND AND FIRED ONCE  *  "
        text[:, inside] = letters([(words, 0.09)], 2.6, 0.16, columns, len(inside), gap=0.5)
    cells = smooth_noise(points, 0.11, rng)
    cracks = np.exp(-((cells / 0.06) ** 2)) * _band(share, 0.74, 0.99)
    height = np.where(outer, flutes + meander + 0.012 * text - 0.006 * cracks, 0.0)
    return closed_ball(displace(points, height + 0.001 * smooth_noise(points, 0.03, rng)))


def scaled_ring(faces: int, rng: np.random.Generator) -> Triangles:
    """A torus covered with overlapping scales, standing on its side, leaning back."""
    columns, rows = _sides(faces, 2.1)
    u, v = np.arange(columns)[:, None] / columns, np.arange(rows)[None] / rows
    tube = 0.34 * (1 + 0.06 * np.sin(TURN * 3 * u))
    ring = 0.66 + tube * np.cos(TURN * v)
    points = np.stack(np.broadcast_arrays(ring * np.cos(TURN * u), ring * np.sin(TURN * u), tube * np.sin(TURN * v)),
                      axis=-1)  # fmt: skip
    height = 0.022 * scales(u, v, 30, 84) + 0.0015 * smooth_noise(points, 0.02, rng)
    return closed_tube(displace(points, height, closed_rows=True))


def cloth(faces: int, rng: np.random.Generator) -> Triangles:
    """A square cloth that hangs over a ball, in folds, with the threads of its weave on both sides."""
    columns, rows = _sides(faces / 2, 1.0)
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows), indexing="ij")
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    hanging = np.clip(radius - 0.45, 0, None)
    phases = rng.uniform(0, TURN, 3)
    folds = np.cos(7 * angle + phases[0]) + 0.5 * np.cos(12 * angle + phases[1] + 4 * radius)
    middle = 0.5 * np.sqrt(np.clip(1 - np.clip(radius, 0, 0.99) ** 2, 0.02, None)) - 0.55 * hanging
    middle = middle + 0.16 * folds * hanging + 0.02 * smooth_noise(np.stack([x, y], axis=-1), 0.5, rng)
    weave = 0.007 * woven_threads(x, y, 1 / 56)
    upper = np.stack([x, y, middle + 0.008 + weave], axis=-1)
    lower = np.stack([x, y, middle - 0.008 - weave], axis=-1)
    return closed_slab(upper, lower)


def bust(faces: int, rng: np.random.Generator) -> Triangles:
    """A head on a neck, looking to -Y, with hair combed down from its crown."""
    columns, rows = _sides(faces, 1.1)
    u, v = periodic_coordinates(columns, rows)
    profile = [(0, 0.0, -1.0), (0.06, 0.4, -1.0), (0.1, 0.42, -0.95), (0.18, 0.3, -0.8), (0.28, 0.24, -0.6),
               (0.36, 0.27, -0.45), (0.46, 0.43, -0.28), (0.6, 0.55, 0.05), (0.75, 0.56, 0.42), (0.88, 0.42, 0.72),
               (0.96, 0.2, 0.86), (1, 0.0, 0.9)]  # fmt: skip
    radius, height = (_smooth_interp(v, profile, column) for column in (1, 2))
    side = np.angle(np.exp(1j * (TURN * u + np.pi / 2)))  # angle from the face, which looks to -Y
    face = _bump(side, height, 0.0, -0.02, 0.13, 0.13) * 0.17 + _bump(side, height, 0.0, -0.33, 0.3, 0.09) * 0.08
    for eye in (-0.38, 0.38):
        face = face - _bump(side, height, eye, 0.14, 0.17, 0.08) * 0.07
        face = face + _bump(side, height, eye, 0.14, 0.1, 0.05) * 0.05
        face = face + _bump(side, height, eye, 0.25, 0.24, 0.04) * 0.035
    face = face + _bump(side, height, 0, -0.19, 0.16, 0.025) * 0.05 + _bump(side, height, 0, -0.25, 0.13, 0.025) * 0.05
    for ear in (-1.6, 1.6):
        face = face + _bump(side, height, ear, 0.02, 0.1, 0.14) * 0.1
    x, y = (radius + face) * np.sin(side), -(1.15 * radius + face) * np.cos(side)
    points = np.stack(np.broadcast_arrays(x, y, height), axis=-1)
    hairline = 0.44 - 0.75 * np.clip((np.abs(side) - 0.7) / 1.2, 0, 1) + 0.01 * np.sin(40 * side)
    hair = np.clip((height - hairline) / 0.05, 0, 1) * np.clip((0.9 - height) / 0.1, 0, 1)
    skin = 0.0012 * smooth_noise(points, 0.02, rng)
    return closed_ball(displace(points, hair * (0.02 + 0.03 * strands(u, v, 360, rng)) + (1 - hair) * skin))


def coin(faces: int, rng: np.random.Generator) -> Triangles:
    """A standing coin, its faces to -Y and +Y."""
    columns, rows = _sides(faces, 2.6)
    u, v = periodic_coordinates(columns, rows)
    ring = np.interp(v, [0, 0.47, 0.53, 1], [0, 1, 1, 0])
    across = 0.07 * np.interp(v, [0, 0.47, 0.53, 1], [-1, -1, 1, 1])
    rim = 0.025 * _band(ring, 0.93, 1.01)
    text = np.zeros((columns, rows))
    words = "Z-BUFFER TO PICTURE  *  POINTS STRUCK INTO A COIN  *  MMXXVI  *  "
    for front in (True, False):
        inside = np.flatnonzero((ring[0] > 0.72) & (ring[0] < 0.9) & ((v[0] < 0.5) == front))
        if len(inside):
            ink = letters([(words, 0.1)], TURN * 0.8, 0.18, columns, len(inside), gap=0.4)
            text[:, inside] = ink[::-1] if front else ink[:, ::-1][::-1]
    petals = 0.45 + 0.12 * np.cos(TURN * 12 * u)
    rosette = np.abs(np.sin(np.pi * 24 * (ring / petals))) * _band(ring, 0.12, 0.62)
    lines = np.abs(np.sin(np.pi * (90 * u + 14 * ring))) * np.abs(np.sin(np.pi * (90 * u - 14 * ring)))
    relief = rim + 0.022 * text + 0.010 * rosette + 0.008 * lines * _band(ring, 0.12, 0.62)
    reeds = 0.012 * np.abs(np.sin(np.pi * 150 * u)) * _band(v, 0.475, 0.525)
    radius = ring - reeds
    height = across + np.sign(across) * relief * (ring < 1)
    x, z = radius * np.cos(TURN * u), radius * np.sin(TURN * u)
    height = height + 0.0008 * smooth_noise(np.stack(np.broadcast_arrays(x, across, z), axis=-1), 0.03, rng)
    vertices, triangles = closed_ball(np.stack(np.broadcast_arrays(x, -height, z), axis=-1)[:, ::-1])
    return vertices, triangles[:, ::-1]


DETAILED_MESHES: dict[str, Callable[[int, np.random.Generator], Triangles]] = {
    "tablet": tablet, "vase": vase, "scales": scaled_ring, "cloth": cloth, "bust": bust, "coin": coin,
}  # fmt: skip
"""Name of a mesh -> the function that makes it. A mesh's seed is its place: add new ones at the end."""


def _sides(faces: float, ratio: float) -> tuple[int, int]:
    """Columns and rows of a grid of about `faces` triangles, with `ratio` as many columns as rows."""
    rows = max(8, round(float(np.sqrt(faces / 2 / ratio))))
    return max(8, round(rows * ratio)), rows


def _band(at: np.ndarray, first: float, last: float) -> np.ndarray:
    """1 between first and last, 0 elsewhere, over edges 0.008 wide."""
    edge = 0.008
    band: np.ndarray = np.clip((at - first) / edge, 0, 1) * np.clip((last - at) / edge, 0, 1)
    return band


def _bump(
    side: np.ndarray, height: np.ndarray, at_side: float, at_height: float, wide: float, tall: float
) -> np.ndarray:
    """A bell, 1 at one place and wide and tall to 1 / e."""
    bump: np.ndarray = np.exp(-(((side - at_side) / wide) ** 2) - ((height - at_height) / tall) ** 2)
    return bump


def _smooth_interp(v: np.ndarray, profile: list[tuple[float, float, float]], column: int) -> np.ndarray:
    """The profile's lines, rounded where they meet: averaged over some of v, over less of it near both ends."""
    at = np.array(profile)
    reach = np.minimum(0.03, np.minimum(v, 1 - v))
    samples = [np.interp(v + share * reach, at[:, 0], at[:, column]) for share in np.linspace(-1, 1, 17)]
    curve: np.ndarray = np.mean(samples, axis=0)
    return curve


def _meander(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A Greek key: 1 on its line, 0 beside; one repeats over a unit of x, y is in [0, 1]."""
    key = np.array([[1, 1, 1, 1, 1, 1, 1, 1], [0, 0, 0, 0, 0, 0, 0, 0], [1, 1, 1, 1, 1, 1, 0, 1],
                    [1, 0, 0, 0, 0, 1, 0, 1], [1, 0, 1, 1, 0, 1, 0, 1], [1, 0, 0, 1, 0, 1, 0, 1],
                    [1, 1, 1, 1, 0, 1, 0, 1], [0, 0, 0, 0, 0, 1, 1, 1]], float)  # fmt: skip
    column = np.clip((x % 1.0 * 8).astype(int), 0, 7)
    row = np.clip((y * 8).astype(int), 0, 7)
    return key[row, column]
