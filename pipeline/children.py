"""Processes that z2p starts of itself: luigi's, and Blender's."""

from __future__ import annotations

import os

from storage.code import ROOT


def child_environment() -> dict[str, str]:
    """Environment in which ``python -m`` runs this installation's packages, and nothing of the working folder.

    Names such as `storage` are common: a folder or a file of the user's must not stand in for ours.
    """
    earlier = os.environ.get("PYTHONPATH")
    paths = os.pathsep.join([str(ROOT.resolve()), *([earlier] if earlier else [])])
    return {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": paths}
