"""How to get what an extra brings: one sentence for every message that gives such advice."""

from __future__ import annotations

ENGINE_EXTRAS = frozenset({"openvino", "torch"})
"""Packages of engines that are extras of the same name; the others come with z2p itself."""


def install_advice(extra: str = "") -> str:
    """What to type for an extra of z2p, or for the whole of it: in a clone, for z2p stands on no package index."""
    place = f".[{extra}]" if extra else "."
    return f'to get it, in a clone of z2p: pip install -c constraints.txt "{place}"'
