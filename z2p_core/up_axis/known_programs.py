"""Programs and devices that name themselves in file headers, and the axis that points up in their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

_Y_UP_SUFFIXES = (".obj",)
"""Suffixes of graphics formats: exporters turn their scenes to +Y for these, whatever axis they use themselves."""
PROGRAMS: Sequence[tuple[str, str, tuple[str, ...]]] = (
    ("+Y", "Polycam", ("polycam", "poly cam")),
    ("+Y", "Scaniverse", ("scaniverse",)),
    ("+Y", "3D Scanner App", ("3d scanner app", "3dscannerapp")),
    ("+Y", "Record3D", ("record3d", "record 3d")),
    ("+Y", "Stray Scanner", ("stray scanner", "strayscanner")),
    ("+Y", "augmented reality on phones", ("arkit", "arcore")),
    ("+Y", "phones", ("iphone", "ipad", "smartphone", "with a phone", "with my phone", "with phone", "on a phone",
                      "on my phone", "by phone", "from a phone", "using a phone", "phone scan")),
    ("+Y", "scans of Stanford", ("zipper output", "vrip")),
    ("+Y", "Unity", ("unity3d", "unity engine", "unity editor", "unity 20", "from unity", "by unity", "in unity")),
    ("+Y", "Maya", ("autodesk maya", "from maya", "by maya", "in maya", "maya 20")),
    ("+Y", "ZBrush", ("zbrush",)),
    ("-Y", "COLMAP", ("colmap",)),
    ("-Y", "Gaussian splats", ("3dgs", "gsplat", "gaussian splatting", "gaussian-splatting")),
    ("+Z", "Blender", ("blender",)),
    ("+Z", "SketchUp", ("sketchup",)),
    ("+Z", "3ds Max", ("3ds max", "3dsmax")),
    ("+Z", "PDAL", ("pdal",)),
    ("+Z", "LAStools", ("lastools", "las2txt", "las2las")),
    ("+Z", "tiles of surveys", ("entwine", "potreeconverter")),
    ("+Z", "surveyors' scanners", ("faro scene", "leica cyclone", "cyclone register", "riscan", "trimble realworks")),
    ("+Z", "lidars", ("veloview", "velodyne", "ouster", "livox", "hesai")),
)  # fmt: skip
"""The axis that is usually up in such files, what they are, and the names, in lower case, by which they are known.

Programs that keep whatever axes they are given (CloudCompare, MeshLab, Open3D) say nothing.
"""
_FIXED_AXIS_PROGRAM = "exported from brush"
"""Brush writes ``Vertical axis: y`` into all of its files, whichever axis points up in them."""


def program_up(lines: Sequence[str], suffix: str) -> tuple[str, str]:
    """The axis that usually points up in files of the program that the comments name, and that program.

    Both are empty if no known program is named, or programs with different axes are.
    """
    text = "\n".join(" ".join(line.lower().replace("_", " ").split()) for line in lines)
    matches = [(axis, label) for axis, label, names in PROGRAMS if any(_contains_name(text, name) for name in names)]
    if suffix in _Y_UP_SUFFIXES:
        matches = [("+Y", label) if axis == "+Z" else (axis, label) for axis, label in matches]
    return matches[0] if len({axis for axis, _ in matches}) == 1 else ("", "")


def writes_fixed_axis(line: str) -> bool:
    """Whether a comment names a program that writes the same axis into all files."""
    return _contains_name(line.lower(), _FIXED_AXIS_PROGRAM)


def _contains_name(text: str, name: str) -> bool:
    """Whether a text contains a name as whole words, perhaps followed by a number."""
    ends = ((at, at + len(name)) for at in _occurrences(text, name))
    return any(not text[at - 1 : at].isalnum() and not text[end : end + 1].isalpha() for at, end in ends)


def _occurrences(text: str, name: str) -> Iterator[int]:
    at = text.find(name)
    while at >= 0:
        yield at
        at = text.find(name, at + 1)
