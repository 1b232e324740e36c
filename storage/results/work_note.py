"""Work folders carry a JSON note with their entry's fields, so that unfinished work can be adopted too."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from z2p_core.errors.value_limits import JsonObject, ListOf, OrNone, Text, check_value
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.bounded_json import read_json

NOTE = ".entry.json"
"""Hidden file; deleted with the other leftovers once the result is published."""
_LINE = Text("a text", r"(?s:.*)", 100_000)
_NOTE = JsonObject({"name": _LINE, "fields": JsonObject({}),
              "adopted": OrNone(JsonObject({"from": _LINE, "differences": ListOf(_LINE, 0, 100_000)}))})  # fmt: skip


def write_note(folder: Path, name: str, fields: Mapping[str, Any], adopted: Mapping[str, Any] | None = None) -> None:
    """Note which result a work folder is for, and, after an adoption, where the work came from."""
    atomic_write(json.dumps({"name": name, "fields": dict(fields), "adopted": adopted}).encode(), folder / NOTE)


def read_note(folder: Path) -> dict[str, Any] | None:
    """``name``, ``fields`` and ``adopted`` (or None) of a work folder; None if there is no valid note."""
    with suppress(OSError, ValueError):
        note = read_json((folder / NOTE).read_bytes())
        check_value(note, _NOTE, "")
        return dict(note)
    return None
