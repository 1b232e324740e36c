"""Finds the scans that a command's inputs name: files, folders and glob patterns."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

from z2p_core.formats.colmap_files import is_colmap_part, is_colmap_points
from z2p_core.interfaces import ScanError
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.scans.content_detection import is_prose, is_unrelated_bin
from z2p_renderer.storage.scans.reader_choice import format_suffix, readable_suffixes
from z2p_renderer.storage.scans.unsupported_formats import advice_by_suffix, is_unread_cloud


def find_scans(
    inputs: Sequence[str], recursive: bool, passed_over: Callable[[Path], None] = lambda path: None, named: bool = False
) -> list[Path]:
    """The files that the inputs name, in the inputs' order, each once.

    A file names itself. A folder names the readable files in it, sorted; with `recursive`, also those below it.
    Anything else is a glob pattern. Folders and globs skip hidden files and links to folders: such a link leads to
    files that are either listed anyway or outside. They also skip prose (a .txt or .csv that begins with neither
    numbers nor column names, unless the user `named` the columns) and clouds in unsupported formats; `passed_over` is
    called with each of these.

    Raises:
        ScanError: an input is empty, a URL or matches nothing, or a folder or pattern has no readable file.
    """
    scans: dict[str, Path] = {}
    for text in inputs:
        if not text:
            raise ScanError("expected a file, folder or pattern, got ''; is the variable empty that should hold it?")
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", text):
            raise ScanError(f"{text!r} is a URL; z2p reads local files only, so download it first")
        try:
            paths = _expand(text, recursive, passed_over, named)
        except ScanError:
            raise
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ScanError(f"{printable(Path(text))}: cannot be searched ({reason})") from error
        for path in paths:
            scans.setdefault(os.path.abspath(path), path)  # noqa: PTH100 - Path.resolve would join links to one file
    return list(scans.values())


MAX_COMPARED_NAMES = 5000
"""At most this many names of a folder are compared to a misspelled one."""
PICTURE_SUFFIXES = frozenset({".png", ".webp", ".jpg", ".jpeg", ".tif", ".tiff", ".gif", ".mp4"})
"""Suffixes of files that z2p writes."""


def _missing_file_advice(path: Path) -> str:
    """Advice for a path that does not exist: a similar name in its folder, if one is clearly meant."""
    if path.suffix.lower() in PICTURE_SUFFIXES:
        return f"a picture that is to be written is named by --output {printable(path)}"
    from z2p_core.errors.did_you_mean import closest_name  # imported late: only this message needs it

    try:
        siblings = [other.name for other in islice(path.parent.iterdir(), MAX_COMPARED_NAMES)]
        numbers = re.findall(r"\d+", path.name)  # another number of a series is not meant
        meant = closest_name(path.name, [name for name in siblings if re.findall(r"\d+", name) == numbers])
    except OSError:  # the folder does not exist either, or cannot be listed
        meant = None
    return "check the path" if meant is None else f"did you mean {printable(path.with_name(meant))}?"


def _expand(text: str, recursive: bool, passed_over: Callable[[Path], None], named: bool) -> list[Path]:
    """The files that one input names."""
    path = Path(text)
    if path.is_dir():
        name, candidates = f"folder {printable(path)}", list(_walk(path)) if recursive else _children(path)
    elif path.exists() or path.is_symlink():
        return [path]
    elif any(sign in text for sign in "*?["):
        name, candidates = f"pattern {text!r}", _glob(path)
    else:
        raise ScanError(f"{printable(path)}: no such file or folder; {_missing_file_advice(path)}")
    suffixes = readable_suffixes()
    model_folders = {other.parent for other in candidates if is_colmap_points(other)}
    paths = []
    for candidate in candidates:
        if is_colmap_part(candidate) and candidate.parent in model_folders:
            continue  # the reader of a COLMAP model's points reads these files itself
        if format_suffix(candidate) not in suffixes:
            if is_unread_cloud(candidate):
                passed_over(candidate)
        elif is_prose(candidate, named) or is_unrelated_bin(candidate, named):
            passed_over(candidate)
        else:
            paths.append(candidate)
    if not paths:
        first = next(filter(is_unread_cloud, candidates), None)
        unread = f"; {first.name} {advice_by_suffix(first)}" if first else ""
        advice = "" if recursive or not path.is_dir() else "; --recursive looks into its folders too"
        raise ScanError(f"{name} holds no point cloud; readable: {', '.join(suffixes)}{unread}{advice}")
    return paths


def _children(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if not path.name.startswith(".") and not path.is_dir())


def _walk(root: Path) -> Iterator[Path]:
    """Files below the folder in a fixed order; links to folders are not followed, so no link can loop or lead out."""

    def refuse(error: OSError) -> None:
        raise error

    for folder, folders, _ in os.walk(root, onerror=refuse, followlinks=False):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from _children(Path(folder))


def _glob(pattern: Path) -> list[Path]:
    """Files that match; ``**`` does not follow links to folders."""
    parts = pattern.parts
    first = next(index for index, part in enumerate(parts) if any(sign in part for sign in "*?["))
    root = Path(*parts[:first])
    if any("**" in part != "**" for part in parts[first:]):  # from 3.13 on Python reads it as one asterisk
        raise ValueError("'**' stands for folders, between two slashes")
    matches = root.glob(str(Path(*parts[first:])))
    visible = (path for path in matches if not any(part.startswith(".") for part in path.relative_to(root).parts))
    return sorted(path for path in visible if not path.is_dir())
