"""The JSON lines of `z2p render --json`, which programs read: one for each file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.batch.render_files import Outcome
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer


def settings_to_json(renderer: AnyRenderer, look: Look, options: dict[str, Any]) -> dict[str, Any]:
    """The settings that all pictures of a run share, as JSON."""
    controls = {name: list(value) for name, value in renderer.settings(look.values).items()}
    elevation = controls.get("elevation", [renderer.fixed_elevation])
    return {
        "weights": options["weights"],
        "controls": controls,
        "elevation": elevation[0],
        "up": look.placement_options.up,
        "view": options["view"],
        "azimuth": look.placement_options.azimuth,
        "keep_outliers": look.placement_options.keep_outliers,
        "cut_top": look.placement_options.cut_top,
        "smooth": look.placement_options.smooth,
        "resolution": [look.width, look.height],
        "background": "transparent" if look.background is None else list(look.background),
        "supersample": look.supersample,
        "fit": options["fit"],
        "margin": options["margin"],
        "color_by": look.color_options.by,
        "style": look.style.name,
        "radius": look.style.radius_text,
        "load_camera": None if options["load_camera"] is None else str(options["load_camera"]),
    }


def outcome_to_json(outcome: Outcome, settings: dict[str, Any]) -> dict[str, Any]:
    """A file's outcome as JSON; `output` is the path of the first of `outputs`, which most files have one of.

    `settings` are those of `settings_to_json`; `stances` are up, view and elevation as chosen for each picture, and
    `weights` are the names of the weights that drew each.
    """
    from z2p_renderer.storage.scans.unpack import is_spooled

    stances = [stance.to_json() for stance in outcome.placements]
    for stance in stances:
        stance["elevation"] = settings["elevation"] if stance["elevation"] is None else stance["elevation"]
    return {
        "input": "-" if is_spooled(outcome.scan) else str(outcome.scan),
        "output": str(outcome.outputs[0]),
        "outputs": [str(path) for path in outcome.outputs if path.is_file()],
        "status": outcome.status,
        "points": outcome.points,
        "dropped": outcome.dropped,
        "repeated": outcome.repeated,
        "total": outcome.total or outcome.points + outcome.dropped + outcome.repeated,
        "seconds": round(outcome.seconds, 4),
        "error": outcome.error,
        "note": outcome.note,
        "stances": stances,
        "weights": outcome.weights,
        "colors": outcome.colors,
        "settings": settings,
    }
