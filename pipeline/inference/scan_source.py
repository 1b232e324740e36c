"""Where a picture's cloud is, for the picture's record."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from z2p_renderer.storage.results.fingerprints import file_digest
from z2p_renderer.storage.scans.unpack import is_spooled


def describe_source(
    scan: Path, output: Path, cloud: int = 0, columns: tuple[str, ...] | None = None
) -> dict[str, Any]:
    """Where a picture's cloud is, for its record: the file's name, digest and place beside the picture.

    `cloud` counts within the file. The path is relative to the picture, so that the two can move together; what came
    through standard input has none.
    """
    source = {"name": scan.name, "path": path_relative_to(scan, output), "sha256": file_digest(scan), "cloud": cloud}
    if columns is not None:
        source["columns"] = list(columns)
    return {**source, "path": None} if is_spooled(scan) else source


def path_relative_to(scan: Path, output: Path) -> str:
    """Where a scan lies, as seen from the folder of a picture."""
    path = os.path.relpath(os.path.abspath(scan), os.path.abspath(output.parent))  # noqa: PTH100 - keeps links
    return Path(path).as_posix()
