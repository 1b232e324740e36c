"""Telemetry of the libraries that z2p uses: it is switched off."""

from __future__ import annotations

import os


def forbid_telemetry() -> None:
    """Keeps onnxruntime, from its first import on, from writing an identity to the user's cache and reporting it.

    Users who want it set ``ORT_DISABLE_TELEMETRY=0``.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
