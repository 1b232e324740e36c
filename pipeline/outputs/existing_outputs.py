"""Pictures and loops that are there already: whether they show the cloud that is asked for, and as it is asked for."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from z2p_core.placement.margin import with_margin
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RECORDED_OPTIONS
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer, AutoRenderer
from z2p_renderer.pipeline.placement.place_scan import FIXED_CAMERA
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.image_files import PictureError, is_readable_picture, is_truncated, read_record


def kept_output_note(
    picture: Path, source: Mapping[str, Any], look: Look, renderer: AnyRenderer,
    motion: Mapping[str, Any] | None = None, named: bool = False,
) -> str | None:
    """What to say of a picture that stays as it is, in words or nothing; None where it is to be drawn.

    That is so where its scan has changed since, or nothing is in the file; also, for one that the user `named`, where
    it shows the scan otherwise than asked. `source` and `motion` are what a new picture's record would say of its cloud
    and, of a loop, of its frames; `renderer` is what would draw it. A picture without a record is another program's,
    and stays; so does an MP4, whose record only its players read.

    Raises:
        PictureError: it shows another cloud, or nothing that can be read.
    """
    if picture.stat().st_size == 0:
        return None
    if picture.suffix.lower() == ".mp4":
        return ""
    try:
        record = read_record(picture)
    except PictureError:
        record = {}
    if is_truncated(picture) if record else not is_readable_picture(picture):
        raise PictureError(f"{printable(picture)} is there already, but is no picture that can be read; remove it, "
                           "choose another --output, or --overwrite")
    if not record:
        return "without a record of z2p"
    drawn = record.get("input", {})
    if all(drawn.get(name) == source[name] for name in ("sha256", "cloud")):
        others = _changed_settings(record, source, look, renderer) + _changed_motion(record.get("motion"), motion)
        if named and others:
            return None
        return f"with another {' and another '.join(others)}" if others else ""
    if source["path"] is not None and drawn.get("path") == source["path"]:
        return None
    path = drawn.get("path")
    other = "of standard input" if path is None else printable(Path(os.path.normpath(picture.parent / path)))
    raise PictureError(f"{printable(picture)} is there already and shows another cloud, {other}: choose another "
                       "--output, or --overwrite")  # fmt: skip


def _changed_motion(drawn: Mapping[str, Any] | None, asked: Mapping[str, Any] | None) -> list[str]:
    """What of a loop's motion is otherwise than asked."""
    if drawn is None or asked is None:
        return [] if drawn is asked else ["motion"]
    return [{"kind": "motion"}.get(name, name) for name, value in asked.items() if drawn.get(name) != value]


def _changed_settings(record: Mapping[str, Any], source: Mapping[str, Any], look: Look, renderer: AnyRenderer) -> list[str]:
    """What of the settings a picture was drawn with otherwise."""
    others = _changed_controls(record, look, renderer)
    viewpoint, placed = look.placement_options.viewpoint, record.get("placing", {})
    if _has_other_camera(record, look):
        others.append("camera")
    replaced = () if viewpoint is None else ("up", "view")
    others += [name.replace("_", "-") for name in RECORDED_OPTIONS
               if name in placed and name not in replaced and placed[name] != getattr(look.placement_options, name)]  # fmt: skip
    background = "transparent" if look.background is None else list(look.background)
    asked_for = {"resolution": [look.width, look.height], "background": background, "supersample": look.supersample,
                 "fit": "tight" if look.tight else "frame", "margin": look.margin}  # fmt: skip
    others += [name for name, value in asked_for.items() if record.get(name) != value]
    if _has_other_weights(record, renderer):
        others.append("choice of weights")
    if look.crop is not None and record.get("window") != list(look.crop):
        others.append("crop")
    if record.get("input", {}).get("columns") != source.get("columns"):
        others.append("choice of columns")
    return others


def _changed_controls(record: Mapping[str, Any], look: Look, renderer: AnyRenderer) -> list[str]:
    """The controls that a picture was drawn with otherwise; one that is not given has its slider's default."""
    drawn, asked = record.get("controls", {}), renderer.settings(look.values)
    if "elevation" not in look.values and record.get("stance", {}).get("elevation") is not None:
        asked.pop("elevation", None)  # the view chose it
    return [name for name, value in asked.items() if name in drawn and drawn[name] != list(value)]


def _has_other_camera(record: Mapping[str, Any], look: Look) -> bool:
    """Whether a picture was taken by another camera than the given one; or by a given one, where now none is."""
    viewpoint = with_margin(look.placement_options.viewpoint, look.frame_margin) if look.placement_options.viewpoint else None
    if viewpoint is None:
        return bool(record.get("stance", {}).get("up") == FIXED_CAMERA)
    drawn, asked = record.get("camera", {}), viewpoint.to_json()
    turned = look.placement_options.azimuth or record.get("placing", {}).get("azimuth")
    return any(drawn.get(name) != asked[name] for name in ("centre", "radius", *(() if turned else ("rotation",))))


def _has_other_weights(record: Mapping[str, Any], renderer: AnyRenderer) -> bool:
    """Whether other weights drew a picture, or may have: those that the cloud chooses are known only to its record."""
    if isinstance(renderer, AutoRenderer):
        return not record.get("weights_chosen", True)  # once it was not told
    return bool(record.get("weights", {}).get("sha256") != renderer.weights["sha256"])
