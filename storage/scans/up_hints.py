"""Finds statements about a scan's up axis: in comments of its header, and in files beside it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from z2p_core.formats.tables.header_lines import COMMENT_SIGNS, text_encoding
from z2p_core.interfaces import RawCloud
from z2p_core.up_axis.axis_names import parse_up_axis
from z2p_core.up_axis.choose import STANDARD_AXES
from z2p_core.up_axis.header_comments import UpHint, axis_of_vector, up_of_comments
from z2p_renderer.storage.files.bounded_json import MAX_BYTES, read_json
from z2p_renderer.storage.files.printable_names import is_file, printable, without_gz
from z2p_renderer.storage.scans.reader_choice import BUILTIN_SUFFIXES

_HEAD_BYTES = 1 << 13
"""Bytes at the beginning of a file that are searched for comments."""
_MAX_COMMENTS = 200
"""Further comments are ignored."""
_TEXT_SUFFIXES = BUILTIN_SUFFIXES["text"]
_SCENE_SUFFIXES = (".glb", ".gltf")
_UP_AXIS_KEYS = frozenset({"upaxis", "axisup", "upvector", "updirection", "upvec", "worldup", "verticalaxis"})
"""JSON keys of an up axis, lower-case, without word separators; the key ``up`` counts only at the top level."""
_MAX_AXIS_CHARACTERS = 40
"""Longer JSON strings name no axis."""
_XML_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)


def with_up_hints(clouds: Sequence[RawCloud], plain: Path, path: Path) -> list[RawCloud]:
    """The clouds of a file, with the up axis from its header or a file beside it unless the reader is certain of one.

    `plain` is the unpacked file, `path` the file that the user named.
    """
    if all(cloud.up and cloud.up_certain for cloud in clouds):
        return list(clouds)
    suffix = plain.suffix.lower()
    comments = _read_comments(plain, suffix)
    beside = None if suffix in STANDARD_AXES else _hint_from_sibling_files(path)
    return [_with_hint(cloud, up_of_comments(comments, suffix, cloud.up), beside) for cloud in clouds]


def _with_hint(cloud: RawCloud, header: UpHint | None, beside: UpHint | None) -> RawCloud:
    """The cloud with the more certain hint; of two equally certain hints, that of its own header."""
    if cloud.up and cloud.up_certain:
        return cloud
    certain = [hint for hint in (header, beside) if hint is not None and hint.certain]
    usual = [] if cloud.up else [hint for hint in (header, beside) if hint is not None]
    for hint in [*certain, *usual][:1]:
        return replace(cloud, up=hint.axis, up_reason=hint.reason, up_certain=hint.certain, upward=None)
    return cloud


def _read_comments(path: Path, suffix: str) -> list[str]:
    """The comments in the header of a file; empty if its format has none, or the file cannot be read."""
    if suffix not in _COMMENT_PARSERS and suffix not in _TEXT_SUFFIXES:
        return []
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return []
    text = head.decode(text_encoding(head) if suffix in _TEXT_SUFFIXES else "utf-8", errors="replace")
    return [line.strip() for line in _COMMENT_PARSERS.get(suffix, _text_comments)(text)][:_MAX_COMMENTS]


def _ply_comments(text: str) -> Iterable[str]:
    lines = re.split(r"\nend_header", text, maxsplit=1)[0].splitlines()
    return (line.split(None, 1)[1] for line in lines if re.match(r"(?:comment|obj_info)\s+\S", line))


def _pcd_comments(text: str) -> Iterable[str]:
    lines = re.split(r"\nDATA\b", text, maxsplit=1, flags=re.IGNORECASE)[0].splitlines()
    return (line.lstrip("# \t") for line in lines if line.lstrip().startswith("#"))


def _mesh_comments(text: str) -> Iterable[str]:
    return (line.partition("#")[2].lstrip("# ") for line in text.splitlines() if line.lstrip().startswith("#"))


def _text_comments(text: str) -> Iterable[str]:
    signs = ("#", *COMMENT_SIGNS)
    return (line.lstrip("#/;%! \t") for line in text.splitlines() if line.lstrip().startswith(signs))


def _stl_comments(text: str) -> Iterable[str]:
    return [re.split(r"[\r\n\x00]", text[:80])[0].removeprefix("solid ")]


def _vtk_comments(text: str) -> Iterable[str]:
    return text.splitlines()[1:2]


def _xml_comments(text: str) -> Iterable[str]:
    return (line for comment in _XML_COMMENT.findall(text) for line in comment.splitlines())


_COMMENT_PARSERS = {
    ".ply": _ply_comments, ".pcd": _pcd_comments, ".obj": _mesh_comments, ".off": _mesh_comments,
    ".stl": _stl_comments, ".vtk": _vtk_comments,
    ".vtp": _xml_comments, ".vtu": _xml_comments,
}  # fmt: skip
"""Suffix -> function that extracts the comments from the first bytes; text files share `_text_comments`."""


def _hint_from_sibling_files(path: Path) -> UpHint | None:
    """The up axis by files beside a scan: a description in JSON, or a glTF scene of the same name."""
    stem = without_gz(path).stem
    for name in (f"{stem}.json", "metadata.json"):
        if axis := _axis_in_json(path.with_name(name)):
            return UpHint(axis, f"{printable(Path(name))} beside it says so", certain=True)
    if any(is_file(path.with_name(stem + suffix)) for suffix in _SCENE_SUFFIXES):
        return UpHint("+Y", "that of the glTF scene beside it", certain=False)
    return None


def _axis_in_json(path: Path) -> str:
    """The axis that a JSON file names at its top level or one level below; empty if it names none or several."""
    try:
        if not is_file(path) or path.stat().st_size > MAX_BYTES:
            return ""
        read = read_json(path.read_bytes())
    except (OSError, ValueError):  # the points are drawn all the same
        return ""
    top = read if isinstance(read, dict) else {}
    inner = [pair for value in top.values() if isinstance(value, dict) for pair in value.items()]
    entries = [(re.sub(r"[ _.-]", "", key.lower()), value) for key, value in [*top.items(), *inner]]
    axes = {_parse_axis(value) for key, value in entries if key in _UP_AXIS_KEYS} | {_parse_axis(top.get("up"))}
    axes.discard("")
    return axes.pop() if len(axes) == 1 else ""


def _parse_axis(value: Any) -> str:
    """The axis of a JSON value such as ``"Y"``, ``"Z_UP"`` or [0, 0, 1]; empty for any other value."""
    if isinstance(value, str) and len(value) <= _MAX_AXIS_CHARACTERS:
        axis = parse_up_axis(value) or ""
        return "" if axis == "auto" else axis
    if isinstance(value, list) and len(value) == 3 and all(type(number) in (int, float) for number in value):
        return axis_of_vector(value)
    return ""
