"""Makes meshes of man-made objects for training: furniture, lamps, vessels, aeroplanes, cars, pipes, potted plants.

    python scripts/build_objects.py OUT [--each 4] [--seed 0]

Collections of figures hold few thin plates and bars as in furniture, whose two sides are closer to each other than
sparse points are. As in catalogues of furniture, parts intersect and sheets may have no thickness. Sizes are about one;
objects stand on the floor, +Z up.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mesh_parts import TURN, Part, bar, block, box, curve, joined, lathe, moved, patch, tube, turned_smooth

from z2p_renderer.storage.meshes import write_mesh

Rng = np.random.Generator


def main() -> None:
    """Writes the objects as PLY files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--each", type=int, default=4, help="objects of each kind")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for index, (kind, build) in enumerate(KINDS.items()):
        for number in range(options.each):
            parts = build(np.random.default_rng([options.seed, index, number]))
            write_mesh(options.out / f"{kind}-{number}.ply", *joined(parts))


def legs(rng: Rng, wide: float, deep: float, height: float, thick: float) -> list[Part]:
    """Support of a seat or a top: four round, square or splayed legs, two panels, or one column."""
    parts: list[Part] = []
    kind = rng.integers(5)
    corners = [(x * (wide - thick) / 2, y * (deep - thick) / 2) for x in (-1, 1) for y in (-1, 1)]
    if kind == 3:
        return [side for x in (-1, 1) for side in box((thick, deep, height), (x * (wide - thick) / 2, 0, height / 2))]
    if kind == 4:
        spread = 0.35 * max(wide, deep)
        foot = lathe([(0, thick), (spread, thick), (spread, 0), (0, 0)])
        if rng.random() < 0.5:
            tips = [(spread * math.cos(at), spread * math.sin(at), thick / 2) for at in np.arange(5) * TURN / 5]
            foot = [side for tip in tips for side in bar((0, 0, thick), tip, thick / 2)]
        return foot + bar((0, 0, 0), (0, 0, height), thick)
    splay = 0.12 * rng.random() if kind == 2 else 0.0
    for x, y in corners:
        if kind == 1:
            parts += box((thick, thick, height), (x, y, height / 2))
        else:
            parts += bar((x * (1 + splay), y * (1 + splay), 0), (x, y, height), thick / 2)
    if rng.random() < 0.4:  # a stretcher on either side
        at = height * rng.uniform(0.2, 0.6)
        parts += [side for x in (-1, 1) for side in bar((x * (wide - thick) / 2, -deep / 2, at),
                                                        (x * (wide - thick) / 2, deep / 2, at), thick / 3)]  # fmt: skip
    return parts


def slab(rng: Rng, wide: float, deep: float, at: float, thick: float) -> list[Part]:
    """A flat top: a box, or round."""
    if rng.random() < 0.25:
        radius = (wide + deep) / 4
        return lathe([(0, at + thick), (radius, at + thick), (radius, at), (0, at)])
    return box((wide, deep, thick), (0, 0, at + thick / 2))


def chair(rng: Rng) -> list[Part]:
    """A seat on legs; its back a plate, slats, bars or a bent sheet; with arms or without."""
    wide, deep, height = rng.uniform(0.4, 0.6), rng.uniform(0.4, 0.6), rng.uniform(0.35, 0.5)
    thick, back, lean = rng.uniform(0.015, 0.06), rng.uniform(0.35, 0.65), rng.uniform(0, 0.3)
    parts = legs(rng, wide, deep, height, rng.uniform(0.02, 0.06)) + slab(rng, wide, deep, height, thick)
    top, behind, kind = height + back, deep / 2, rng.integers(4)
    rear = behind + lean * back
    if kind == 0:
        middle = (0, (behind + rear) / 2, (height + top) / 2)
        parts += box((wide, thick, back), middle, tilt=-math.atan(lean))
    elif kind == 1:
        t = np.linspace(-1, 1, 24)
        rows = [np.column_stack([wide / 2 * t, np.full(24, y) - 0.3 * wide * t**2, np.full(24, z)])
                for y, z in zip(np.linspace(behind, rear, 12), np.linspace(height, top, 12), strict=True)]  # fmt: skip
        parts.append(moved(patch(np.array(rows)), (0, 0.3 * wide, 0)))
    else:
        count = int(rng.integers(2, 8))
        for x in (-1, 1):
            parts += bar((x * wide / 2.1, behind, height), (x * wide / 2.1, rear, top), thick / 1.5)
        for share in (np.arange(count) + 0.5) / count:
            if kind == 2:
                x = wide * (share - 0.5)
                parts += bar((x, behind, height), (x, rear, top), thick / 3)
            else:
                y, z = behind + share * (rear - behind), height + share * back
                parts += box((wide, thick / 2, 0.5 * back / count), (0, y, z), tilt=-math.atan(lean))
        parts += box((wide, thick, 0.05), (0, rear, top))
    if rng.random() < 0.35:
        for x in (-1, 1):
            parts += box((0.05, deep, thick), (x * wide / 2, 0, height + 0.22))
            parts += bar((x * wide / 2, -0.4 * deep, height), (x * wide / 2, -0.4 * deep, height + 0.22), 0.015)
    return parts


def table(rng: Rng) -> list[Part]:
    """A top on legs; with a shelf below, or with vessels on it."""
    wide, deep, height = rng.uniform(0.6, 1.4), rng.uniform(0.5, 0.9), rng.uniform(0.3, 0.8)
    thick = rng.uniform(0.015, 0.06)
    parts = legs(rng, wide, deep, height, rng.uniform(0.03, 0.09)) + slab(rng, wide, deep, height, thick)
    if rng.random() < 0.3:
        parts += box((0.9 * wide, 0.9 * deep, thick), (0, 0, 0.35 * height))
    if rng.random() < 0.4:
        for vertices, faces in vessel(rng):
            parts.append(moved((0.3 * vertices, faces), (0.2 * wide * rng.uniform(-1, 1), 0, height + thick)))
    return parts


def shelf(rng: Rng) -> list[Part]:
    """Boards between panels, open or with a back, with some drawers and books."""
    wide, deep, height = rng.uniform(0.4, 1.2), rng.uniform(0.2, 0.45), rng.uniform(0.5, 1.6)
    thick, rows, columns = rng.uniform(0.012, 0.04), int(rng.integers(2, 6)), int(rng.integers(1, 4))
    parts = []
    for z in np.linspace(thick / 2, height - thick / 2, rows + 1):
        parts += box((wide, deep, thick), (0, 0, z))
    for x in np.linspace(-0.5, 0.5, columns + 1):
        parts += box((thick, deep, height), (x * (wide - thick), 0, height / 2))
    if rng.random() < 0.5:
        parts += box((wide, thick / 3, height), (0, deep / 2, height / 2))
    for row in range(rows):
        for column in range(columns):
            cell = (wide / columns, height / rows)
            x, z = (column + 0.5) * cell[0] - wide / 2, row * cell[1]
            if rng.random() < 0.2:
                parts += box((0.96 * cell[0], deep, 0.92 * cell[1]), (x, -0.02, z + cell[1] / 2))
            elif rng.random() < 0.3:
                for at in np.arange(-0.4, 0.4, 0.12):
                    tall = cell[1] * rng.uniform(0.5, 0.85)
                    parts += box((0.09 * cell[0], 0.7 * deep, tall), (x + at * cell[0], 0, z + thick + tall / 2))
    return parts


def lamp(rng: Rng) -> list[Part]:
    """A foot, a straight or bent pole, and a shade without thickness."""
    foot, height, pole = rng.uniform(0.1, 0.25), rng.uniform(0.5, 1.5), rng.uniform(0.008, 0.03)
    parts = lathe([(0, 0.03), (foot, 0.03), (foot, 0), (0, 0)])
    reach = rng.uniform(0, 0.5) if rng.random() < 0.5 else 0.0
    parts += tube(curve([(0, 0, 0), (0, 0, height), (reach / 2, 0, 1.2 * height), (reach, 0, height)]), pole)
    low, high, tall = rng.uniform(0.12, 0.35), rng.uniform(0.03, 0.2), rng.uniform(0.12, 0.4)
    parts += lathe([(low, height - tall), (high, height)], at=(reach, 0, 0))
    if rng.random() < 0.5:
        t = np.linspace(0, math.pi, 20)
        parts.append(moved(turned_smooth(0.05 * np.sin(t), -0.05 * np.cos(t), 24), (reach, 0, height - tall / 2)))
    return parts


def vessel(rng: Rng) -> list[Part]:
    """A bowl, cup or bottle, with a wall or without, some with a handle."""
    height = rng.uniform(0.3, 1.0)
    t = np.linspace(0, 1, 40)
    swell = rng.uniform(0.1, 0.4) + 0.12 * sum(rng.normal() * np.cos(k * math.pi * t) / k for k in (1, 2, 3))
    radii = np.maximum(swell, 0.05)
    parts = [turned_smooth(radii, height * t), *lathe([(0, 0), (radii[0], 0)])]
    if rng.random() < 0.6:
        wall = rng.uniform(0.01, 0.04)
        parts += [turned_smooth(radii - wall, wall + (height - wall) * t), *lathe([(0, wall), (radii[0] - wall, wall)])]
        parts += lathe([(radii[-1] - wall, height), (radii[-1], height)])
    if rng.random() < 0.5:
        low, high = (int(40 * share) for share in (rng.uniform(0.1, 0.3), rng.uniform(0.65, 0.9)))
        out = radii.max() + rng.uniform(0.1, 0.3)
        places = [(radii[low], 0, height * t[low]), (out, 0, height * t[low]), (out, 0, height * t[high]),
                  (radii[high], 0, height * t[high])]  # fmt: skip
        parts += tube(curve(places), rng.uniform(0.015, 0.04))
    return parts


def aeroplane(rng: Rng) -> list[Part]:
    """A fuselage with thin tapered wings and tail, on the floor as models are."""
    long, thick, span = 1.0, rng.uniform(0.05, 0.09), rng.uniform(0.8, 1.2)
    t = np.linspace(0, math.pi, 40)
    hull, faces = turned_smooth(thick * np.sin(t) ** rng.uniform(0.3, 0.7), 0.5 * long * np.cos(t))
    up = thick + rng.uniform(0, 0.1)
    parts = [moved((hull[:, [1, 2, 0]], faces), (0, 0, up))]
    sweep = rng.uniform(0, 0.35)
    parts += wing(0.05, rng.uniform(0.15, 0.3), span / 2, sweep, rng.uniform(0.01, 0.03), up - 0.3 * thick)
    parts += wing(0.45, 0.13, rng.uniform(0.15, 0.22), sweep / 2, 0.012, up + 0.2 * thick)
    fin = np.array([[[-0.006, 0.33, up], [-0.006, 0.48, up]], [[0.006, 0.33, up], [0.006, 0.48, up]]])
    parts += block(fin, np.add(fin, (0, 0.1, rng.uniform(0.15, 0.25))))
    for x in (-1, 1) if rng.random() < 0.6 else ():
        place = x * span * rng.uniform(0.15, 0.25)
        parts += bar((place, -0.05, up - thick), (place, 0.15, up - thick), 0.04)
    return parts


def wing(at: float, deep: float, reach: float, sweep: float, thick: float, height: float) -> list[Part]:
    """Two tapered wings, mirror images, swept back along y."""
    root = np.array([[[0, at - deep / 2, 0], [0, at + deep / 2, 0]], [[0, at - deep / 2, 1], [0, at + deep / 2, 1]]])
    tip = (root - (0, at, 0)) * (1, 0.4, 0.5) + (reach, at + sweep, 0.2)
    scale, lift = (1, 1, thick), (0, 0, height)
    right = block(root * scale + lift, tip * scale + lift)
    return right + [(vertices * (-1, 1, 1), faces) for vertices, faces in right]


def car(rng: Rng) -> list[Part]:
    """A body, a cabin of sheets on posts, and four wheels."""
    long, wide, low, high = 1.0, rng.uniform(0.38, 0.48), rng.uniform(0.06, 0.12), rng.uniform(0.12, 0.2)
    parts = box((wide, long, high), (0, 0, low + high / 2))
    roof, length, inset = rng.uniform(0.1, 0.2), rng.uniform(0.4, 0.8), rng.uniform(0.05, 0.15)
    base = np.array([[[x * wide / 2.1, y * length / 2, low + high] for y in (-1, 1)] for x in (-1, 1)])
    top = base * (0.85, 1 - 2 * inset / length, 1) + (0, 0, roof)
    if rng.random() < 0.5:
        parts += block(base, top)
    else:
        parts += [patch(top), *(side for x in (0, 1) for y in (0, 1) for side in bar(base[x, y], top[x, y], 0.012))]
        parts += box((0.3 * wide, 0.12, 0.14), (0.2 * wide, -0.1, low + high + 0.05))
    wheel, tyre = rng.uniform(0.08, 0.11), rng.uniform(0.04, 0.08)
    for x in (-1, 1):
        for y in (-0.32, 0.32):
            inner, outer = (x * wide / 2 + side * tyre / 2 for side in (-1, 1))
            parts += bar((inner, y, wheel), (outer, y, wheel), wheel, 32)
    return parts


def pipes(rng: Rng) -> list[Part]:
    """Bent bars, thick and thin, and a spring."""
    parts = []
    for _ in range(int(rng.integers(2, 7))):
        places = rng.uniform((-0.5, -0.5, 0.05), (0.5, 0.5, 0.9), (int(rng.integers(2, 6)), 3))
        parts += tube(curve([tuple(place) for place in places]), rng.uniform(0.01, 0.06))
    if rng.random() < 0.5:
        t = np.linspace(0, TURN * rng.uniform(3, 7), 240)
        radius = rng.uniform(0.1, 0.3)
        spring = np.column_stack([radius * np.cos(t), radius * np.sin(t), 0.05 + 0.8 * t / t[-1]])
        parts += tube(spring, rng.uniform(0.01, 0.03))
    return parts


def plant(rng: Rng) -> list[Part]:
    """A pot, stems, and leaves that are bent sheets without thickness."""
    parts = lathe([(0, 0), (0.12, 0), (0.17, 0.25), (0.15, 0.25), (0.14, 0.2), (0, 0.2)])
    for _ in range(int(rng.integers(4, 14))):
        angle, reach, top = rng.uniform(0, TURN), rng.uniform(0.1, 0.5), rng.uniform(0.4, 1.0)
        out = np.array([math.cos(angle), math.sin(angle), 0])
        path = curve([(0, 0, 0.2), (0, 0, top), tuple(reach * out + (0, 0, top))])
        parts += tube(path[:25], 0.006, 8)
        leaf = path[20:] + np.linspace(0, 1, 20)[:, None] * (0.1 * out + (0, 0, -0.1))
        across = np.cross(out, (0, 0, 1)) * rng.uniform(0.04, 0.1)
        width = np.sin(np.linspace(0.1, math.pi, 20))[:, None] ** 0.7
        fold = rng.uniform(0, 0.05) * width * (0, 0, 1)
        parts.append(patch(np.stack([leaf + width * across + fold, leaf, leaf - width * across + fold])))
    return parts


KINDS: dict[str, Callable[[Rng], list[Part]]] = {
    "chair": chair, "table": table, "shelf": shelf, "lamp": lamp, "vessel": vessel, "aeroplane": aeroplane, "car": car,
    "pipes": pipes, "plant": plant,
}  # fmt: skip


if __name__ == "__main__":
    main()
