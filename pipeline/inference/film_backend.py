"""Films for `z2p_core.animate`: of one cloud, of a series, or of clouds side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.api.backend import FilmRequest
from z2p_core.interfaces import SettingError, Value
from z2p_renderer.pipeline.batch.common_view import CloudGroup
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import build_record, with_common_scale
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.outputs.animation import Motion
from z2p_renderer.pipeline.outputs.film import FilmPlan, film_record, plan_film
from z2p_renderer.pipeline.outputs.series import CloudSeries
from z2p_renderer.pipeline.outputs.turning_grid import draw_openings, grid_frames
from z2p_renderer.storage.images.animations import write_animation
from z2p_renderer.storage.scans.clouds import Scan

Clouds = Sequence[tuple[Scan, str]]
"""Scans, each with its file's suffix."""


def write_film(
    clouds: Clouds, colors: Sequence[Value | None], renderer: AnyRenderer, look: Look, film: FilmRequest,
    source: Mapping[str, Any], path: Path,
) -> list[str]:  # fmt: skip
    """Writes the film that a request asks for; returns what to warn of.

    `colors` are those of the clouds where each has its own, and `source` describes the first cloud.

    Raises:
        SettingError: a series has several colors.
    """
    if len(clouds) > 1 and film.arrange == "series":
        if any(color is not None for color in colors):
            raise SettingError("expected one color for a series, got a list; arrange='table' shows clouds side by side")
        return _write_series(clouds, renderer, look, film, source, path)
    look, _ = with_common_scale(renderer, clouds, look) if len(clouds) > 1 else (look, None)
    motion = Motion(film.motion, film.frames)
    openings = draw_openings(clouds, colors, renderer, look)
    record = {**build_record(openings[0][0], look, source), "motion": {**asdict(motion), "fps": film.fps}}
    if len(clouds) > 1:
        record["batch"] = len(clouds)
    frames = _counted(grid_frames(clouds, openings, motion), film, film.frames)
    write_animation(frames, path, film.fps, look.background, record)
    return []


def _write_series(
    clouds: Clouds, renderer: AnyRenderer, look: Look, film: FilmRequest, source: Mapping[str, Any], path: Path
) -> list[str]:  # fmt: skip
    plan = FilmPlan(film.hold, film.blend, film.blend_by, film.turns, film.closes, film.reference)
    groups = [CloudGroup("", suffix, lambda scan=scan: [scan]) for scan, suffix in clouds]  # type: ignore[misc]
    planned = plan_film(CloudSeries(groups), renderer, look, plan)
    record = film_record(build_record(planned.opening, planned.look, source), planned, film.fps)
    frames = _counted(planned.frames(), film, planned.frame_count)
    write_animation(frames, path, film.fps, planned.look.background, record)
    return list(planned.notes)


def _counted(frames: Iterator[np.ndarray], film: FilmRequest, total: int) -> Iterator[np.ndarray]:
    """The frames; each is reported once it is drawn."""
    for number, frame in enumerate(frames):
        if film.on_frame is not None:
            film.on_frame(number + 1, total)
        yield frame
