"""Kinds of objects and scenes with an up axis, besides those of build_objects.py: people, animals, houses, rooms.

The choice of the up axis is trained and measured with them. Sizes are in metres; all stand on the floor, +Z up.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from build_objects import KINDS as OBJECTS
from build_objects import chair, lamp, plant, shelf, table, vessel
from mesh_parts import Part, bar, box, curve, lathe, moved, patch, tube, turned_smooth

Rng = np.random.Generator


def egg(at: tuple[float, float, float], *half: float) -> list[Part]:
    """An ellipsoid."""
    t = np.linspace(0, math.pi, 24)
    places, faces = turned_smooth(np.sin(t), np.cos(t), 32)
    return [(places * half + at, faces)]


def person(rng: Rng) -> list[Part]:
    """A standing person, on a base or without one, the arms down, out or up."""
    tall, wide = rng.uniform(1.5, 1.9), rng.uniform(0.16, 0.24)
    hip, neck, stride = 0.5 * tall, 0.82 * tall, rng.uniform(0, 0.3)
    parts = egg((0, 0, (hip + neck) / 2), wide, 0.6 * wide, (neck - hip) / 1.7)
    parts += egg((0, 0, 0.93 * tall), 0.09, 0.1, 0.13)
    lift = rng.uniform(-1.3, 1.3) if rng.random() < 0.4 else -1.3
    for x in (-1, 1):
        foot = (x * wide * 0.7, x * stride, 0.04)
        parts += bar((x * wide * 0.5, 0, hip), foot, rng.uniform(0.06, 0.08))
        parts += box((0.1, 0.26, 0.08), (foot[0], foot[1] - 0.06, 0.04))
        hand = (x * (wide + 0.6 * math.cos(lift)), rng.uniform(-0.2, 0.1), neck - 0.06 + 0.6 * math.sin(lift))
        parts += bar((x * wide, 0, neck - 0.06), hand, 0.045)
    if rng.random() < 0.25:
        parts = [moved(part, (0, 0, 0.1)) for part in parts] + box((0.8, 0.8, 0.1), (0, 0, 0.05))
    return parts


def beast(rng: Rng) -> list[Part]:
    """A body on four legs, with neck, head and tail."""
    long, high, thick = rng.uniform(0.4, 0.8), rng.uniform(0.3, 0.9), rng.uniform(0.12, 0.28)
    parts = egg((0, 0, high), thick, long, thick * rng.uniform(0.9, 1.3))
    rise, out = rng.uniform(0.1, 0.7), rng.uniform(0.1, 0.4)
    parts += bar((0, -0.8 * long, high), (0, -long - out, high + rise), rng.uniform(0.06, 0.12))
    parts += egg((0, -long - out - 0.06, high + rise), 0.09, 0.16, 0.1)
    end = (0, long + rng.uniform(0.1, 0.4), high + rng.uniform(-0.3, 0.4))
    parts += tube(curve([(0, 0.9 * long, high), (0, long + 0.2, high), end]), 0.03)
    for x in (-1, 1):
        if rng.random() < 0.7:
            parts += bar((0.05 * x, -long - out, high + rise), (0.1 * x, -long - out, high + rise + 0.2), 0.025)
        for y in (-0.65, 0.65):
            at, step = (x * 0.6 * thick, y * long), rng.uniform(-0.1, 0.1)
            parts += bar((*at, high), (at[0], at[1] + step, 0), rng.uniform(0.03, 0.07))
    return parts


def bird(rng: Rng) -> list[Part]:
    """A body upright or level, on two legs or a socket."""
    lean, legs = rng.uniform(0.1, 1.3), rng.uniform(0.05, 0.4)
    along = np.array([0, -math.cos(lean), math.sin(lean)])
    middle = np.array([0, 0, legs + 0.25])
    path = middle + np.linspace(-0.35, 0.3, 24)[:, None] * along
    parts = tube(path, 0.17 * np.sin(np.linspace(0.1, math.pi - 0.2, 24)) ** 0.7)
    head = tuple((middle + 0.36 * along + (0, -0.03, 0.06)).tolist())
    parts += egg(head, 0.09, 0.1, 0.09) + bar(head, (0, head[1] - 0.18, head[2] - 0.02), 0.02)
    if rng.random() < 0.4:
        return parts + lathe([(0, 0), (0.25, 0), (0.2, legs + 0.1), (0, legs + 0.1)])
    for x in (-0.07, 0.07):
        parts += bar((x, 0, legs + 0.2), (x, 0, 0), 0.015) + box((0.08, 0.16, 0.015), (x, -0.03, 0.01))
    return parts


def bust(rng: Rng) -> list[Part]:
    """Head and shoulders, cut off below, open or closed, or on a socket."""
    parts = egg((0, -0.02, 0.62), 0.13, 0.16, 0.19) + bar((0, 0, 0.25), (0, 0, 0.55), rng.uniform(0.08, 0.1))
    wide, low = rng.uniform(0.2, 0.32), rng.uniform(0, 0.2)
    t = np.linspace(0, 1, 20)
    radii = wide * np.sqrt(1 - 0.9 * t**2)
    places, faces = turned_smooth(radii, low + (0.34 - low) * t)
    parts += [(places * (1, 0.6, 1), faces), *egg((0, -0.18, 0.6), 0.03, 0.04, 0.03)]
    if rng.random() < 0.3:
        parts += lathe([(0, low), (0.12, low), (0.15, low - 0.3), (0, low - 0.3)])
    elif rng.random() < 0.6:
        disc = lathe([(0, low), (wide, low)])
        parts += [(places * (1, 0.6, 1), faces) for places, faces in disc]
    return parts


def tree(rng: Rng) -> list[Part]:
    """A trunk under a crown of leaves, a cone or a few balls."""
    tall, thick = rng.uniform(0.5, 2.5), rng.uniform(0.05, 0.15)
    parts = bar((0, 0, 0), (0, 0, tall + 0.3), thick)
    if rng.random() < 0.4:
        for level in np.linspace(0, 1, int(rng.integers(2, 5))):
            wide = 0.9 - 0.6 * level
            parts += lathe([(wide, tall + level), (0, tall + level + 0.9)])
        return parts
    for _ in range(int(rng.integers(3, 9))):
        x, y, z = rng.normal(0, 0.35, 3).tolist()
        size = rng.uniform(0.25, 0.6)
        parts += egg((x, y, z + tall + 0.7), size, size, 0.8 * size)
    return parts


def house(rng: Rng) -> list[Part]:
    """Walls under a roof, with a chimney or a tower, on a piece of ground or without one."""
    wide, long, high, ridge = rng.uniform(4, 9), rng.uniform(5, 14), rng.uniform(2.5, 7), rng.uniform(1, 4)
    parts = box((wide, long, high), (0, 0, high / 2))
    over = rng.uniform(1, 1.2)
    for x in (-1, 1):
        slope = np.array([[[x * over * wide / 2, y * over * long / 2, high] for y in (-1, 1)],
                          [[0, y * over * long / 2, high + ridge] for y in (-1, 1)]])
        parts.append(patch(slope))
    if rng.random() < 0.5:
        parts += box((0.8, 0.8, ridge), (wide / 4, long / 4, high + ridge * 0.7))
    if rng.random() < 0.3:
        parts += box((0.5 * wide, 0.5 * wide, 2 * high), (0, long / 2, high))
    if rng.random() < 0.5:
        parts += box((2.2 * wide, 2 * long, 0.1), (0, 0, -0.05))
    return parts


def bed(rng: Rng) -> list[Part]:
    """A mattress on a frame, with a head board and pillows; or a sofa."""
    wide, long, high = rng.uniform(0.9, 2), rng.uniform(1.8, 2.1), rng.uniform(0.3, 0.5)
    parts = box((wide, long, 0.2), (0, 0, high))
    parts += [side for x in (-1, 1) for y in (-1, 1)
              for side in box((0.08, 0.08, high), (x * wide / 2.1, y * long / 2.1, high / 2))]  # fmt: skip
    parts += box((wide, 0.06, rng.uniform(0.6, 1.1)), (0, long / 2, high))
    for x in (-0.25, 0.25):
        parts += egg((x * wide, 0.38 * long, high + 0.14), 0.2 * wide, 0.18, 0.07)
    return parts


def sofa(rng: Rng) -> list[Part]:
    """A seat with a back and arms."""
    wide, deep = rng.uniform(0.8, 2.2), rng.uniform(0.7, 0.95)
    seat, back, foot = rng.uniform(0.35, 0.45), rng.uniform(0.75, 1), rng.uniform(0, 0.12)
    parts = box((wide, deep, seat - foot), (0, 0, (seat + foot) / 2))
    parts += box((wide, 0.2, back - foot), (0, deep / 2, (back + foot) / 2))
    for x in (-1, 1):
        parts += box((0.15, deep, 0.2 + seat - foot), (x * wide / 2, 0, (seat + foot + 0.2) / 2))
        for y in (-0.4, 0.4):
            parts += bar((x * wide / 2.2, y * deep, 0), (x * wide / 2.2, y * deep, foot + 0.01), 0.03)
    return parts


def monitor(rng: Rng) -> list[Part]:
    """A screen on a foot."""
    wide, high, at = rng.uniform(0.35, 0.8), rng.uniform(0.25, 0.45), rng.uniform(0.1, 0.2)
    parts = box((wide, rng.uniform(0.02, 0.08), high), (0, 0, at + high / 2), tilt=rng.uniform(-0.2, 0))
    parts += box((0.06, 0.04, at + 0.1), (0, 0.04, (at + 0.1) / 2))
    round_foot = lathe([(0, 0.02), (0.14, 0.02), (0.14, 0), (0, 0)])
    return parts + (round_foot if rng.random() < 0.5 else box((0.3, 0.2, 0.02), (0, 0.02, 0.01)))


def room(rng: Rng) -> list[Part]:
    """Floor and walls, two to four of them, with furniture; the ceiling sometimes."""
    wide, long, high = rng.uniform(3, 6), rng.uniform(3, 7), rng.uniform(2.3, 2.8)
    parts = [patch(np.array([[[x * wide / 2, y * long / 2, 0] for y in (-1, 1)] for x in (-1, 1)]))]
    walls = [(np.array([[[x * wide / 2, y * long / 2, z] for z in (0, high)] for y in (-1, 1)])) for x in (-1, 1)]
    walls += [(np.array([[[x * wide / 2, y * long / 2, z] for z in (0, high)] for x in (-1, 1)])) for y in (-1, 1)]
    parts += [patch(walls[index]) for index in rng.permutation(4)[: rng.integers(1, 5)]]
    if rng.random() < 0.5:
        parts.append((parts[0][0] + (0, 0, high), parts[0][1]))
    for _ in range(int(rng.integers(3, 8))):
        build = (chair, table, shelf, lamp, bed, sofa, plant, person)[rng.integers(8)]
        at = (rng.uniform(-0.4, 0.4) * wide, rng.uniform(-0.4, 0.4) * long, 0)
        parts += [moved(part, at) for part in build(rng)]
    return parts


def street(rng: Rng) -> list[Part]:
    """Ground with houses, trees and poles."""
    side = rng.uniform(30, 60)
    t = np.linspace(-side / 2, side / 2, 24)
    x, y = np.meshgrid(t, t, indexing="ij")
    wave = rng.uniform(0, 1.5) * np.sin(x / 11 + rng.uniform(0, 6)) * np.cos(y / 13)
    parts = [patch(np.stack([x, y, wave], axis=-1))]
    for _ in range(int(rng.integers(3, 12))):
        at = (*rng.uniform(-0.45 * side, 0.45 * side, 2).tolist(), 0)
        grown = [(3 * places, faces) for places, faces in tree(rng)]
        build = (house(rng), grown, bar((0, 0, 0), (0, 0, 8), 0.15))[rng.integers(3)]
        parts += [moved(part, at) for part in build]
    return parts


def land(rng: Rng) -> list[Part]:
    """Hills, with trees and houses on them or bare, as measured from the air."""
    side, steps = rng.uniform(50, 400), 40
    t = np.linspace(-0.5, 0.5, steps)
    x, y = np.meshgrid(t, t * rng.uniform(0.3, 1), indexing="ij")
    height = rng.normal(0, 0.2) * x + rng.normal(0, 0.2) * y
    for scale in (1, 2, 4, 8):
        phase, wave_vectors = rng.uniform(0, 6, 2), rng.normal(size=(2, 2)) * 3 * scale
        (a, b), (c, d) = wave_vectors
        wave = np.sin(a * x + b * y + phase[0]) * np.cos(c * x + d * y + phase[1])
        height = height + rng.uniform(0, 0.12) / scale * wave
    parts = [patch(side * np.stack([x, y, height], axis=-1))]
    for _ in range(int(rng.integers(0, 25))):
        row, column = rng.integers(steps, size=2)
        build, at = (tree, house)[rng.integers(2)], tuple((side * np.array([x, y, height])[:, row, column]).tolist())
        parts += [moved((1.5 * places, faces), at) for places, faces in build(rng)]
    return parts


def post(rng: Rng) -> list[Part]:
    """A pole without a foot, as of a street lamp or a sign, with an arm, two, a board or nothing but a knob."""
    tall, thick, arm = rng.uniform(2, 8), rng.uniform(0.02, 0.12), rng.uniform(0.3, 1.8)
    parts = bar((0, 0, 0), (0, 0, tall), thick)
    kind, rise = rng.integers(4), rng.choice([0.0, rng.uniform(-0.1, 0.3)])
    for x in (-1, 1) if kind == 1 else (1,):
        if kind < 2 and rng.random() < 0.4:
            parts += box((arm, rng.uniform(0.5, 3) * thick, 0.001), (x * arm / 2, 0, tall))
        elif kind < 2:
            parts += bar((0, 0, tall), (x * arm, 0, tall + rise), rng.uniform(0.05, 0.7) * thick)
        if kind == 0 and rng.random() < 0.6:
            parts += box((0.4, 0.15, 0.1), (x * arm, 0, tall + 0.1))
    if kind == 2:
        parts += box((0.5 * arm + 0.2, 0.03, 0.5 * arm + 0.2), (0, 0.05, tall - 0.3))
    return parts + (egg((0, 0, tall + 0.1), 0.2, 0.2, 0.25) if kind == 3 else [])


def flat(rng: Rng) -> list[Part]:
    """A flat object: a board, a book, a dish, a phone, a cake."""
    wide, deep = rng.uniform(0.3, 1), rng.uniform(0.3, 1)
    high = min(wide, deep) * rng.uniform(0.02, 0.5)
    kind = rng.integers(3)
    if kind == 0:
        return box((wide, deep, high), (0, 0, high / 2))
    top = wide / 2 * rng.uniform(0.8, 1.2)
    round_one = lathe([(0, 0), (wide / 2, 0), (top, high), (0, high if kind == 1 else 0.1 * high)])
    return [(places * (1, rng.uniform(0.6, 1), 1), faces) for places, faces in round_one]


def still_life(rng: Rng) -> list[Part]:
    """Vessels and boxes on a plate or a piece of floor, as of a table scene."""
    side = rng.uniform(1, 2)
    parts = box((side, side * rng.uniform(0.6, 1), 0.02), (0, 0, -0.01))
    for _ in range(int(rng.integers(1, 6))):
        at = (*rng.uniform(-0.3, 0.3, 2).tolist(), 0)
        size = rng.uniform(0.1, 0.4)
        if rng.random() < 0.4:
            parts += box((size, rng.uniform(0.1, 0.3), rng.uniform(0.1, 0.3)), (at[0], at[1], 0.1), rng.uniform(0, 3))
        else:
            build = (vessel, plant, bust)[rng.integers(3)]
            parts += [moved((0.5 * places, faces), at) for places, faces in build(rng)]
    return parts


def garden_chair(rng: Rng) -> list[Part]:
    """A chair, a table or a beast on a wide piece of floor, as phones scan them."""
    build = (chair, table, beast, person, sofa)[rng.integers(5)]
    half = rng.uniform(0.6, 1.5)
    floor = patch(np.array([[[x * half, y * half, 0] for y in (-1, 1)] for x in (-1, 1)]))
    return [*build(rng), floor]


def tower(rng: Rng) -> list[Part]:
    """Boxes or rounds, each on the one below and mostly smaller: monuments, machines, chess pieces."""
    parts, at, wide = [], 0.0, rng.uniform(0.3, 0.8)
    for _ in range(int(rng.integers(2, 6))):
        high = rng.uniform(0.1, 0.6)
        if rng.random() < 0.5:
            parts += box((wide, wide * rng.uniform(0.6, 1), high), (0, 0, at + high / 2))
        else:
            top = wide * rng.uniform(0.6, 1)
            parts += lathe([(0, at), (wide / 2, at), (top / 2, at + high), (0, at + high)])
        at, wide = at + high, wide * rng.uniform(0.4, 1.05)
    return parts + (egg((0, 0, at + wide / 3), wide / 2, wide / 2, wide / 2) if rng.random() < 0.5 else [])


KINDS: dict[str, Callable[[Rng], list[Part]]] = {
    **{kind: build for kind, build in OBJECTS.items() if kind != "pipes"},
    "person": person, "beast": beast, "bird": bird, "bust": bust, "tree": tree, "house": house, "bed": bed,
    "sofa": sofa, "monitor": monitor, "room": room, "street": street, "land": land, "post": post, "flat": flat,
    "still_life": still_life, "garden_chair": garden_chair, "tower": tower,
}  # fmt: skip
"""Kind -> what builds one. Pipes have no upright."""
