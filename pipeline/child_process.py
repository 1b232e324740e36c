"""The environment of the Python processes that z2p starts: luigi and Blender."""

from __future__ import annotations

import os

from z2p_renderer.storage.results.code_digest import CORE_FOLDER


def child_environment() -> dict[str, str]:
    """Environment in which ``python -m`` runs this installation's packages, and no files of the working folder."""
    earlier = os.environ.get("PYTHONPATH")
    paths = os.pathsep.join([str(CORE_FOLDER.parent.resolve()), *([earlier] if earlier else [])])
    return {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": paths}
