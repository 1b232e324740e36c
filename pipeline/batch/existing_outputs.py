"""Pictures and loops that are there already: whether they show the same cloud, with the same settings."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from z2p_core.coloring.options import AUTO, NONE, RGB
from z2p_core.formats.field_names import field_key
from z2p_core.pinhole import LookAt
from z2p_core.placement.margin import with_margin
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RECORDED_OPTIONS
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer, AutoRenderer
from z2p_renderer.pipeline.placement.placement_record import FIXED_CAMERA
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.image_files import PictureError, is_readable_picture, is_truncated, read_record


def kept_output_note(
    picture: Path, source: Mapping[str, Any], look: Look, renderer: AnyRenderer,
    motion: Mapping[str, Any] | None = None, named: bool = False,
) -> str | None:
    """How an existing picture differs from the settings, in words (or ""), if it is kept; None if it is drawn again.

    It is drawn again if its scan has changed or the file is empty; and, if the user `named` this picture, also if it
    was drawn with other settings. Pictures without a record are another program's and are kept. So are MP4 files,
    whose record cannot be read here.

    Args:
        picture: the existing file.
        source: what the record of a new picture would say of its cloud.
        look: the settings of a new picture.
        renderer: the renderer that would draw it.
        motion: what the record of a new loop would say of its motion; None for pictures.
        named: True if the user named the picture itself, not a folder.

    Raises:
        PictureError: it shows another cloud, or cannot be read.
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
    recorded = record.get("input", {})
    if all(recorded.get(name) == source[name] for name in ("sha256", "cloud")):
        changes = _changed_settings(record, source, look, renderer) + _changed_motion(record.get("motion"), motion)
        if named and changes:
            return None
        return f"with another {' and another '.join(changes)}" if changes else ""
    if source["path"] is not None and recorded.get("path") == source["path"]:
        return None
    path = recorded.get("path")
    other = "of standard input" if path is None else printable(Path(os.path.normpath(picture.parent / path)))
    raise PictureError(f"{printable(picture)} is there already and shows another cloud, {other}: choose another "
                       "--output, or --overwrite")  # fmt: skip


def _changed_settings(
    record: Mapping[str, Any], source: Mapping[str, Any], look: Look, renderer: AnyRenderer
) -> list[str]:
    """Names of the settings that a picture was drawn with and that are different now."""
    changes = _changed_controls(record, look, renderer)
    options, recorded = look.placement_options, record.get("placing", {})
    if _has_other_camera(record, look):
        changes.append("camera")
    replaced_by_camera = () if options.viewpoint is None else ("up", "view")
    changes += [name.replace("_", "-") for name in RECORDED_OPTIONS if name in recorded
                and name not in replaced_by_camera and recorded[name] != getattr(options, name)]  # fmt: skip
    settings = {
        "resolution": [look.width, look.height],
        "background": "transparent" if look.background is None else list(look.background),
        "supersample": look.supersample,
        "fit": "tight" if look.tight else "frame",
        "margin": look.margin,
        "dpi": look.dpi,
        **{name: value or None for name, value in vars(look.marks).items()},
    }
    if isinstance(options.camera, LookAt) and options.camera.size is None:
        del settings["resolution"]  # it followed from the cloud
    changes += [name for name, value in settings.items() if record.get(name) != value]
    changes += _changed_colors(record, look)
    style = look.style.to_json()
    changes += [name for name in ("style", "radius") if record.get(name) != style.get(name)]
    if _has_other_weights(record, renderer):
        changes.append("choice of weights")
    recorded_camera = record.get("camera", {})
    if options.viewpoint is None and look.zoom.to_json() != {k: recorded_camera[k] for k in ("zoom", "pan")
                                                             if k in recorded_camera}:  # fmt: skip
        changes.append("zoom")
    if look.crop is not None and record.get("window") != list(look.crop):
        changes.append("crop")
    if record.get("input", {}).get("columns") != source.get("columns"):
        changes.append("choice of columns")
    return changes


def _changed_controls(record: Mapping[str, Any], look: Look, renderer: AnyRenderer) -> list[str]:
    """Names of the controls whose values differ from the record's; controls that are not given have their defaults."""
    recorded, settings = record.get("controls", {}), renderer.settings(look.values)
    if "elevation" not in look.values and record.get("stance", {}).get("elevation") is not None:
        settings.pop("elevation", None)  # the automatic view chose the recorded one
    return [name for name, value in settings.items() if name in recorded and recorded[name] != list(value)]


def _changed_colors(record: Mapping[str, Any], look: Look) -> list[str]:
    """Names of the options on the points' colors that differ from the record's."""
    options, recorded = look.color_options, record.get("color_by", NONE)
    if options.field is None:
        expected = {AUTO: (NONE, RGB), RGB: (RGB,), NONE: (NONE,)}[options.by]
        changes = [] if recorded in expected else ["color-by"]
    else:
        changes = [] if field_key(options.field) == field_key(recorded) else ["color-by"]
        asked = {"colormap": options.colormap, "clim": options.limits and list(options.limits)}
        changes += [name for name, value in asked.items() if value is not None and record.get(name) != value]
        if bool(record.get("color_bar")) != options.color_bar:
            changes.append("color-bar")
    if options.relight is not None and recorded != NONE and record.get("relight", options.relight) != options.relight:
        changes.append("relight")
    if tuple(record.get("classes", ())) != options.classes:
        changes.append("classes")
    return changes


def _has_other_camera(record: Mapping[str, Any], look: Look) -> bool:
    """True if the picture was taken with another camera than the loaded one, or with a loaded one if none is now."""
    options = look.placement_options
    wish = None if options.camera is None else options.camera.to_json()
    if wish is not None or "pinhole_wish" in record:
        return bool(record.get("pinhole_wish") != wish)
    if options.viewpoint is None:
        return bool(record.get("stance", {}).get("up") == FIXED_CAMERA)
    recorded, camera = record.get("camera", {}), with_margin(options.viewpoint, look.frame_margin).to_json()
    is_turned = options.azimuth or record.get("placing", {}).get("azimuth")  # then rotations differ, as azimuths may
    compared = ("centre", "radius", "zoom", "pan", *(() if is_turned else ("rotation",)))
    return any(recorded.get(name) != camera.get(name) for name in compared)


def _has_other_weights(record: Mapping[str, Any], renderer: AnyRenderer) -> bool:
    """True if other weights drew the picture, or if the user named weights for one of them only."""
    if isinstance(renderer, AutoRenderer):  # it chooses by the cloud, so the weights themselves cannot be compared
        return not record.get("weights_chosen", True)  # missing in older records
    return bool(record.get("weights", {}).get("sha256") != renderer.weights["sha256"])


def _changed_motion(recorded: Mapping[str, Any] | None, motion: Mapping[str, Any] | None) -> list[str]:
    """Names of the settings of a loop's motion that differ from the record's; both are None for pictures."""
    if recorded is None or motion is None:
        return [] if recorded is motion else ["motion"]
    return [{"kind": "motion"}.get(name, name) for name, value in motion.items() if recorded.get(name) != value]
