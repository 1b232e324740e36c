"""Tasks of a batch: which picture each scan file becomes: names that do not collide, the same for the same input."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from z2p_core.interfaces import ScanError, Value
from z2p_core.pinhole import AnyCamera
from z2p_renderer.storage.files.printable_names import without_gz


@dataclass(frozen=True)
class Task:
    """One scan file and the picture it becomes."""

    scan: Path
    output: Path
    """Of the only cloud; several clouds of one file become `<stem>_000.png`, `<stem>_001.png` ..."""
    single: bool = False
    """The user named the picture itself, so the file must hold one cloud, and other settings draw it again."""
    colors: tuple[Value, ...] = ()
    """Colours of its clouds in turn, in place of the look's; none leaves it that."""
    camera: AnyCamera | None = None
    """A camera in the data's units, in place of the look's; None leaves it that."""


def plan_outputs(
    scans: list[Path], folders: list[Path], out: Path, mirror: bool, suffix: str = ".png"
) -> list[Task]:
    """A task for each scan, each with a picture path of its own under `out`; the same input gives the same names.

    `<stem>.png`, or with another `suffix`; scans that share a stem keep theirs (`a.ply.png`, `a.pcd.png`), and if even
    the names are the same they are numbered (`a.ply.png`, `a.ply-2.png`). With `mirror` the sub folders of `folders`
    are kept.
    """
    sub_folders = [_sub_folder(scan, folders) if mirror else Path() for scan in scans]
    stems = Counter(zip(sub_folders, map(_stem, scans), strict=True))
    taken: set[Path] = set()
    tasks = []
    for sub_folder, scan in zip(sub_folders, scans, strict=True):
        stem = _stem(scan) if stems[sub_folder, _stem(scan)] == 1 else scan.name
        output, number = out / sub_folder / f"{stem}{suffix}", 1
        while output in taken:
            number += 1
            output = out / sub_folder / f"{scan.name}-{number}{suffix}"
        taken.add(output)
        tasks.append(Task(scan, output))
    return tasks


def numbered_outputs(task: Task, count: int, planned: frozenset[Path]) -> list[Path]:
    """Numbered pictures for the clouds of one file; with the file's full name if another file's picture is in the way.

    Raises:
        ScanError: the user named one picture.
    """
    if task.single:
        raise ScanError(f"holds {count} clouds, but --output names one picture; give a folder")
    digits = max(3, len(str(count - 1)))
    for stem in (task.output.stem, task.scan.name):
        outputs = [task.output.parent / f"{stem}_{index:0{digits}d}{task.output.suffix}" for index in range(count)]
        if planned.isdisjoint(outputs):
            break
    return outputs


def _sub_folder(scan: Path, folders: list[Path]) -> Path:
    """Folder of `scan` relative to the first of `folders` that holds it, or none."""
    for folder in folders:
        if scan.is_relative_to(folder):
            return scan.relative_to(folder).parent
    return Path()


def _stem(scan: Path) -> str:
    """The file's name without its suffix, and without .gz."""
    return without_gz(scan).stem
