"""Programs and devices that name themselves in the headers of what they write, and the axis that is up in that."""

from __future__ import annotations

import re
from collections.abc import Sequence

_MESHES = (".obj",)
"""Formats of graphics: exporters turn their scenes to +Y for these, whatever they have themselves."""
PROGRAMS: Sequence[tuple[str, str, str]] = (
    (r"poly ?cam", "Polycam", "+Y"),
    (r"scaniverse", "Scaniverse", "+Y"),
    (r"3d ?scanner ?app", "3D Scanner App", "+Y"),
    (r"record ?3d", "Record3D", "+Y"),
    (r"stray ?scanner", "Stray Scanner", "+Y"),
    (r"ar ?kit|ar ?core", "augmented reality on phones", "+Y"),
    (r"iphone|ipad|smart ?phone|(?:with|by|on|from|using) (?:an? |the |my )?(?:mobile )?phone", "phones", "+Y"),
    (r"zipper output|vrip", "scans of Stanford", "+Y"),
    (r"unity(?: ?3d)?", "Unity", "+Y"),
    (r"(?:autodesk )?maya(?! (?:temple|ruin|site|stela))", "Maya", "+Y"),
    (r"zbrush", "ZBrush", "+Y"),
    (r"colmap", "COLMAP", "-Y"),
    (r"gsplat|3dgs|gaussian[ -]splatting", "Gaussian splats", "-Y"),
    (r"blender", "Blender", "+Z"),
    (r"sketchup", "SketchUp", "+Z"),
    (r"3ds ?max", "3ds Max", "+Z"),
    (r"pdal", "PDAL", "+Z"),
    (r"lastools|las2(?:txt|las|dem)", "LAStools", "+Z"),
    (r"entwine|potree ?converter", "tiles of surveys", "+Z"),
    (r"faro scene|leica cyclone|cyclone register|riscan|trimble realworks", "surveyors' scanners", "+Z"),
    (r"velo ?view|velodyne|ouster|livox|hesai", "lidars", "+Z"),
)
"""A pattern in lower case, whole words of a comment; what it stands for; the axis that is usually up in such files.

Programs that keep whatever axes they are given (CloudCompare, MeshLab, Open3D) say nothing.
"""
_KNOWN = [(re.compile(rf"(?<![a-z0-9])(?:{pattern})(?![a-z])"), name, axis) for pattern, name, axis in PROGRAMS]
_FIXED = re.compile(r"exported from brush(?![a-z])")
"""Brush writes ``Vertical axis: y`` into all of its files, whatever is up in them."""


def program_up(lines: Sequence[str], suffix: str) -> tuple[str, str]:
    """The axis that is usually up in a file with that suffix of a program that its comments name, and its name.

    Both empty where they name none that is known, or such of several axes.
    """
    words = [" ".join(line.lower().replace("_", " ").split()) for line in lines]
    found = [(axis, name) for pattern, name, axis in _KNOWN if any(map(pattern.search, words))]
    if suffix in _MESHES:
        found = [("+Y", name) if axis == "+Z" else (axis, name) for axis, name in found]
    return found[0] if len({axis for axis, _ in found}) == 1 else ("", "")


def writes_fixed_axis(line: str) -> bool:
    """Whether a comment names a program that writes the same axis whatever is up."""
    return _FIXED.search(line.lower()) is not None
