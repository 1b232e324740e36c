"""What libraries would tell their makers, and are told not to."""

from __future__ import annotations

import os


def forbid_telemetry() -> None:
    """Keeps onnxruntime, from its first import on, from writing an identity to the user's cache and reporting it.

    Whoever wants it sets ``ORT_DISABLE_TELEMETRY=0``.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
