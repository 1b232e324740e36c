"""`animate`: points in, a film out: a turntable of one cloud, a series of clouds, or a table of turntables."""

from __future__ import annotations

import inspect
import math
import os
import warnings
from collections.abc import Callable, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.api.backend import FilmRequest, load_backend
from z2p_core.api.render import RenderWarning, build_request, check_names, prepare_clouds, render
from z2p_core.interfaces import ScanError, SettingError

DEFAULT_FRAMES = 48
MOTIONS = ("turn", "orbit", "light")


def animate(
    points: Any,
    path: str | os.PathLike[str],
    colors: Any = None,
    *,
    arrange: str = "series",
    frames: int | None = None,
    fps: float = 24.0,
    motion: str = "turn",
    hold: int = 1,
    blend: int = 0,
    blend_by: str = "auto",
    turns: float = 0.0,
    loop: bool = False,
    reference: str | int = "first",
    on_frame: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Path:
    """The path, once a film of the points is written there: WebP, GIF, APNG or, with the extra 'video', MP4.

    One cloud turns once around, or its light moves, or both. Several clouds are one film: a series in which one follows
    the other (a training run, a diffusion process, a moving scan), or a table of turntables side by side. What could
    jump in a series is chosen once for all of it: camera, scale, floor, weights, network's resolution, scale of colors.

    Args:
        points: as for `z2p_core.render`, one cloud or a batch (B, N, 3); or a list of paths of files.
        path: the film's; an existing file is replaced.
        colors: as for `z2p_core.render`.
        arrange: of several clouds: ``series``, or ``table``: each turns in a cell of its own.
        frames: number of frames of a turn, 2 to 720. None: 48. A series has `hold` and `blend` instead.
        fps: frames per second, 1 to 60; a GIF has at most 50.
        motion: ``turn``; ``orbit``: the light turns too, as if the camera went around; or ``light``: only the light
            moves. For one cloud or a table.
        hold: frames that show each cloud of a series itself.
        blend: frames between one cloud of a series and the next.
        blend_by: ``points`` (each moves to the one of the same number), ``pictures`` (they fade), or ``auto``: points
            where two clouds hold the same ones in the same order.
        turns: how often the object turns in front of the camera during a series.
        loop: whether the last cloud of a series is blended into the first again.
        reference: the cloud of a series that chooses up axis and view: ``first``, ``last`` or its index.
        on_frame: called after each frame with how many are done, and how many there will be.
        **options: all other keywords of `z2p_core.render`: color, light, view, size, background, weights, ...

    Raises:
        ScanError: the points are no clouds (a ValueError).
        SettingError: a setting is invalid (a ValueError).
    """
    film = FilmRequest(
        _choice("arrange", arrange, ("series", "table")), _whole("frames", frames or DEFAULT_FRAMES, 2, 720),
        _number("fps", fps, 1, 60), _choice("motion", motion, MOTIONS), _whole("hold", hold, 1, 1000),
        _whole("blend", blend, 0, 240), _choice("blend_by", blend_by, ("auto", "points", "pictures")),
        _number("turns", turns, -100, 100), bool(loop), _index(reference), on_frame,
    )  # fmt: skip
    if not isinstance(path, str | os.PathLike):
        raise SettingError(f"expected a path to write the film to, got {type(path).__name__}")
    values = _render_settings(points, colors, options)
    files = _files(points)
    request = build_request(points if files is None else files[0], colors, values)
    clouds: Sequence[np.ndarray] | Sequence[Path]
    if files is None:
        clouds, request, notes, _ = prepare_clouds(points, colors, request)
        if not clouds:
            raise ScanError("expected clouds, got an empty batch")
    elif colors is not None and not isinstance(colors, str):
        raise SettingError("colors= of files cannot be matched to their points; name a field, or read the points first")
    else:
        clouds, notes = files, []
    is_series = len(clouds) > 1 and film.arrange == "series"
    if is_series and (frames is not None or motion != "turn"):
        raise SettingError("frames and motion are for one cloud or a table; a series has hold, blend and turns")
    notes = [*notes, *load_backend().animate(clouds, request, film, Path(path))]
    for note in dict.fromkeys(notes):
        warnings.warn(note, RenderWarning, stacklevel=2)
    return Path(path)


def _render_settings(points: Any, colors: Any, options: dict[str, Any]) -> dict[str, Any]:
    """All keywords of `render` but its points and colors, with the defaults of those that are not among `options`."""
    signature = inspect.signature(render)
    check_names({name for name in options if name not in signature.parameters})
    arguments = signature.bind(points, colors, **options)
    arguments.apply_defaults()
    return {name: value for name, value in arguments.arguments.items() if name not in ("points", "colors")}


def _files(points: Any) -> list[Path] | None:
    """The paths in a list of paths, or of one path; None for points."""
    if isinstance(points, str | Path):
        return [Path(points)]
    is_paths = isinstance(points, list | tuple) and points and all(isinstance(one, str | Path) for one in points)
    return [Path(one) for one in points] if is_paths else None


def _choice(name: str, value: Any, known: tuple[str, ...]) -> str:
    if value not in known:
        raise SettingError(f"expected {name} {', '.join(known[:-1])} or {known[-1]}, got {value!r}")
    return str(value)


def _whole(name: str, value: Any, least: int, most: int) -> int:
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    if not (least <= number <= most and number.is_integer()):
        raise SettingError(f"expected {name} as a whole number from {least} to {most}, got {value!r}")
    return int(number)


def _number(name: str, value: Any, least: float, most: float) -> float:
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    if not least <= number <= most:
        raise SettingError(f"expected {name} as a number from {least:g} to {most:g}, got {value!r}")
    return number


def _index(reference: Any) -> int:
    if reference in ("first", "last"):
        return 0 if reference == "first" else -1
    if isinstance(reference, bool) or not isinstance(reference, int):
        raise SettingError(f"expected reference 'first', 'last' or the index of a cloud, got {reference!r}")
    return reference
