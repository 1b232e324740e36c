"""The one sentence by which messages say how to install an extra of z2p."""

from __future__ import annotations

ENGINE_EXTRAS = frozenset({"openvino", "torch"})
"""Engines whose package is an extra of the same name; the packages of the others are installed with z2p."""


def install_advice(extra: str = "") -> str:
    """The command that installs an extra of z2p, or all of z2p, in a clone (z2p is not on a package index)."""
    target = f".[{extra}]" if extra else "."
    return f'to get it, in a clone of z2p: pip install -c constraints.txt "{target}"'
