"""What people call the axis that points up."""

from __future__ import annotations

import re
from typing import Any

_SPELLINGS = re.compile(
    r"((?P<sign>[+-])|(?P<word>plus|minus|pos|neg|positive|negative)[ _-]?)?(?P<axis>[xyz])([ _-]?(up|axis))?"
)


def up_from(wish: Any) -> str | None:
    """``auto``, or an axis with its sign, as ``+Y``, of what was written: ``y``, ``+y``, ``Y-up``; None of all else."""
    text = wish.strip().lower() if isinstance(wish, str) else ""
    if text == "auto":
        return "auto"
    found = _SPELLINGS.fullmatch(text)
    if found is None:
        return None
    below = found["sign"] == "-" or (found["word"] or "") in ("minus", "neg", "negative")
    return ("-" if below else "+") + found["axis"].upper()
