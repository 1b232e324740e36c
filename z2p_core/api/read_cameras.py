"""`read_cameras`: the cameras of a file in the data's units, for `z2p_core.render`."""

from __future__ import annotations

import os
from pathlib import Path

from z2p_core.api.backend import load_backend
from z2p_core.pinhole import PinholeCamera


def read_cameras(path: str | os.PathLike[str]) -> list[PinholeCamera]:
    """The cameras of a file: JSON with K, R and t, nerfstudio's transforms.json, or a COLMAP model or its folder.

    Raises:
        SettingError: the file is missing, or holds none.
    """
    return load_backend().read_cameras(Path(path))
