"""Axes in the data's units: three edges of the cloud's box, on its outline, with ticks at round numbers."""

from __future__ import annotations

from itertools import product

import numpy as np

from z2p_renderer.pipeline.legends.legend_page import LegendPage
from z2p_renderer.pipeline.legends.marks import FrameGeometry
from z2p_renderer.pipeline.legends.tick_labels import choose_ticks

_TICK_LENGTH = 0.45
"""This and the following lengths are in heights of the font."""
_TEXT_DISTANCE = 1.25
"""From an edge to the middle of a tick's text."""
_NAME_DISTANCE = 2.6
"""From an edge to the middle of the axis's name."""
_TICK_PITCH = 2.6
"""Least distance of two ticks of an upright axis."""
_TICK_PITCH_ALONG = 2.2
"""Added to it for a level axis, along which the texts are wide."""
_MOST_TICKS = 4
_LINE_WIDTH = 0.08
_SHORTEST_EDGE = 1.5
"""Shorter edges, such as those of an axis that is looked along, have no ticks."""


def draw_axes(
    page: LegendPage, box: tuple[float, float, float, float], geometry: FrameGeometry, scale: float, unit: str,
    font: float,
) -> None:  # fmt: skip
    """Draws the axes x, y and z of the data onto a picture.

    Args:
        page: the page.
        box: left, top, width and height of the picture on the page, points.
        geometry: where the data is in the picture.
        scale: length of a pixel on the page, points.
        unit: name of the data's unit; empty if it is not known.
        font: size of the texts, points.
    """
    corners = np.array(list(product(*zip(*geometry.bounds, strict=True))))
    pixels, _ = geometry.project(corners)
    places = np.array(box[:2]) + pixels * scale
    middle = places.mean(axis=0)
    for axis in range(3):
        start, end = _outline_edge(axis, corners, places, geometry)
        _draw_axis(page, box, axis, (corners[start], corners[end]), middle, geometry, scale, unit, font)


def _outline_edge(axis: int, corners: np.ndarray, places: np.ndarray, geometry: FrameGeometry) -> tuple[int, int]:
    """The ends, of rising coordinate, of the edge along an axis on the box's outline that lies lowest or, if the edges
    are upright in the picture, leftmost."""
    step = (4, 2, 1)[axis]
    edges = [(index, index + step) for index in range(8) if not index & step]
    middles = np.array([places[list(edge)].mean(axis=0) for edge in edges])
    directions = np.array([places[end] - places[start] for start, end in edges])
    is_upright = bool(np.abs(directions[:, 1]).sum() > np.abs(directions[:, 0]).sum())
    outline = [number for number, edge in enumerate(edges) if _is_on_outline(edge, axis, corners, geometry)]
    candidates = outline or list(range(4))
    position = middles[:, 0] if is_upright else -middles[:, 1]
    return edges[min(candidates, key=lambda number: float(position[number]))]


def _is_on_outline(edge: tuple[int, int], axis: int, corners: np.ndarray, geometry: FrameGeometry) -> bool:
    """Whether exactly one of the two faces at an edge is turned to the camera."""
    eye = geometry.eye
    low, high = (np.array(one) for one in geometry.bounds)
    facing = []
    for other in range(3):
        if other == axis:
            continue
        coordinate = corners[edge[0]][other]
        is_high = coordinate == high[other]
        facing.append(eye[other] > coordinate if is_high else eye[other] < coordinate)
        if low[other] == high[other]:
            return True
    return facing[0] != facing[1]


def _draw_axis(
    page: LegendPage, box: tuple[float, float, float, float], axis: int, ends: tuple[np.ndarray, np.ndarray],
    middle: np.ndarray, geometry: FrameGeometry, scale: float, unit: str, font: float,
) -> None:  # fmt: skip
    """One edge with its ticks, their texts and the axis's name outside of it."""
    places = np.array(box[:2]) + geometry.project(np.array(ends))[0] * scale
    along = places[1] - places[0]
    length = float(np.linalg.norm(along))
    page.line(tuple(places[0]), tuple(places[1]), _LINE_WIDTH * font)
    if length < _SHORTEST_EDGE * font:
        return
    outward = np.array([-along[1], along[0]]) / length
    outward *= 1.0 if outward @ (places.mean(axis=0) - middle) >= 0 else -1.0
    pitch = (_TICK_PITCH + _TICK_PITCH_ALONG * abs(float(along[0])) / length) * font
    most = max(1, min(_MOST_TICKS, int(length / pitch)))
    widest = 0.0
    low, high = float(ends[0][axis]), float(ends[1][axis])
    ticks = list(zip(*choose_ticks(low, high, most), strict=True))
    for value, text in ticks[:: 2 if len(ticks) > most + 1 else 1]:  # few ticks may still be too many
        point = ends[0].copy()
        point[axis] = value
        place = np.array(box[:2]) + geometry.project(point[None])[0][0] * scale
        page.line(tuple(place), tuple(place + _TICK_LENGTH * font * outward), _LINE_WIDTH * font)
        half = page.text_width(text, font) / 2
        widest = max(widest, half)
        away = _TEXT_DISTANCE * font + max(0.0, half - 0.5 * font) * abs(float(outward[0]))
        _draw_inside(page, box, place + away * outward, text, font)
    name = f"{'xyz'[axis]} [{unit}]" if unit else "xyz"[axis]
    away = _NAME_DISTANCE * font + 1.6 * widest * abs(float(outward[0]))
    _draw_inside(page, box, places.mean(axis=0) + away * outward, name, font)


def _draw_inside(
    page: LegendPage, box: tuple[float, float, float, float], place: np.ndarray, text: str, font: float
) -> None:
    """A text around a place, moved as far as it takes to lie within the picture."""
    left, top, width, height = box
    half = page.text_width(text, font) / 2
    x = min(max(float(place[0]), left + half), left + width - half)
    y = min(max(float(place[1]), top + 0.6 * font), top + height - 0.6 * font)
    page.text(x, y, text, font, ha="center", va="center_baseline")
