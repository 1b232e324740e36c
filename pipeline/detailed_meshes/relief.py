"""Heights that are laid over smooth surfaces: noise, scales, threads, strands of hair, letters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

TURN = 2 * np.pi
OVERSAMPLING = 3
"""Side of the letters' pixels: cells of the grid are this many times as large."""


def smooth_noise(points: np.ndarray, wavelength: float, rng: np.random.Generator, waves: int = 24) -> np.ndarray:
    """Noise (...,) of standard deviation 1 at points (..., D): plane waves of random direction, about `wavelength`."""
    noise = np.zeros(points.shape[:-1])
    for _ in range(waves):
        direction = rng.normal(size=points.shape[-1])
        direction *= TURN / (np.linalg.norm(direction) * wavelength * rng.uniform(0.7, 1.4))
        noise += np.cos(points @ direction + rng.uniform(0, TURN))
    scaled: np.ndarray = noise * np.sqrt(2 / waves)
    return scaled


def weathering(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unevenness of stone (...,) of standard deviation about 1 at points (..., 3), from 0.3 units down to 0.02."""
    octaves = [smooth_noise(points, 0.3 / 2**octave, rng, waves=10) / 2**octave for octave in range(4)]
    total: np.ndarray = np.sum(octaves, axis=0)
    return total


def scales(u: np.ndarray, v: np.ndarray, around: int, along: int) -> np.ndarray:
    """Overlapping scales in staggered rows: heights in [0, 1] at u and v, both closed around [0, 1).

    `around` scales lie in a row along v, `along` (even) rows along u. A scale rises towards its rounded end.
    """
    height = np.zeros(np.broadcast_shapes(u.shape, v.shape))
    row = np.floor(u * along)
    for back in (0, 1):  # a scale is two rows long, so that it covers the beginning of the next one
        start = row - back
        progress = (u * along - start) / 2
        across = (v * around + 0.5 * (start % 2)) % 1.0 - 0.5
        inside = progress < 0.55 + 0.45 * np.sqrt(np.clip(1 - (2 * across) ** 2, 0, None))
        rib = 0.05 * np.cos(TURN * 4 * across) * progress
        raised = 0.1 + 0.85 * progress - 0.5 * across**2 + rib
        height = np.maximum(height, np.where(inside, raised, 0))
    return height


def woven_threads(x: np.ndarray, y: np.ndarray, pitch: float) -> np.ndarray:
    """A plain weave's height in [0, 1] at x and y, in the unit of the threads' `pitch`."""
    warp, weft = x / pitch, y / pitch

    def thread(across: np.ndarray, along: np.ndarray, over: np.ndarray) -> np.ndarray:
        round_profile = np.sqrt(np.clip(1 - (2.2 * (across % 1.0 - 0.5)) ** 2, 0, None))
        twist = 0.06 * np.cos(TURN * (3 * along + across))
        return round_profile * (0.55 + 0.4 * over + twist)

    parity = np.pi * np.floor(warp)
    vertical = thread(warp, weft, np.sin(np.pi * weft + parity))
    horizontal = thread(weft, warp, np.sin(np.pi * warp + np.pi * np.floor(weft) + np.pi))
    return np.clip(np.maximum(vertical, horizontal), 0, 1)


def strands(across: np.ndarray, along: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Locks of hair and their strands: heights in [0, 1]; `across` is closed around [0, 1), `along` is in [0, 1].

    `count` strands lie side by side around; locks of some 24 of them wave together.
    """
    phases, shares = rng.uniform(0, TURN, 6), rng.uniform(0.5, 1.0, 6)
    wave = 0.004 * shares[0] * np.sin(TURN * 5 * across + phases[0] + 9 * along)
    wave = wave + 0.008 * shares[1] * np.sin(TURN * 3 * across + phases[1] - 14 * along)
    wave = wave + 0.012 * np.sin(TURN * across + phases[2] + 11 * along)
    bent = across + wave
    locks = np.abs(np.sin(np.pi * (count // 24) * bent + 2 * np.sin(6 * along + phases[3])))
    fine = np.abs(np.sin(np.pi * count * bent + phases[4]))
    finer = np.abs(np.sin(np.pi * 2 * count * bent + phases[5] + 3 * np.sin(20 * along)))
    heights: np.ndarray = 0.5 * locks + 0.35 * fine + 0.15 * finer
    return heights


def letters(
    lines: Sequence[tuple[str, float]], width: float, height: float, columns: int, rows: int, gap: float = 0.8
) -> np.ndarray:
    """Ink (columns, rows) in [0, 1] of centered lines (text, height of its capitals) on an area of width by height.

    Lines are stacked from the top, `gap` times their height apart; the second axis of the result runs up. Edges
    spread over some two cells. A line wider than the area is made smaller.
    """
    from PIL import Image, ImageDraw, ImageFilter, ImageFont

    size = (columns * OVERSAMPLING, rows * OVERSAMPLING)
    picture = Image.new("L", size)
    draw = ImageDraw.Draw(picture)
    scale = size[0] / width
    top = 0.0
    total = sum(capital * (1 + gap) for _, capital in lines)
    margin = max(0.0, (height - total) / 2)
    for text, capital in lines:
        font = ImageFont.load_default(max(2.0, capital * scale / 0.72))
        length = draw.textlength(text, font)
        if length > size[0]:
            font = ImageFont.load_default(max(2.0, capital * scale / 0.72 * size[0] / length))
        middle = (margin + top + capital * (1 + gap) / 2) * size[1] / height
        draw.text((size[0] / 2, middle), text, fill=255, font=font, anchor="mm")
        top += capital * (1 + gap)
    picture = picture.filter(ImageFilter.GaussianBlur(OVERSAMPLING * 0.6)).resize((columns, rows), Image.Resampling.BOX)
    ink: np.ndarray = np.asarray(picture, dtype=np.float64).T[:, ::-1] / 255
    return ink
