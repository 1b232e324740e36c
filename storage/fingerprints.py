"""Fingerprints: what a stage's result depends on, as one sha256. Equal fingerprints promise equal results.

A fingerprint covers meaning only: parameters, upstream fingerprints, input bytes, plugin versions and code. Workers,
threads, folders and log levels are not in it.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

SCHEMA = 1
"""Raised when the meaning of the fields themselves changes; every result becomes stale."""

STAGE_VERSIONS: dict[str, int] = {"shapes": 1, "sample": 1, "render": 1, "shard": 2, "train": 2, "evaluate": 1}
"""Raised by hand when a stage's code starts to give other results; that stage and what follows become stale."""


def fingerprint(fields: Mapping[str, Any]) -> str:
    """sha256 (64 hex digits) of the fields' canonical JSON: sorted keys, no spaces, tuples as lists.

    Raises:
        TypeError: a field that JSON cannot hold.
        ValueError: a float that is not finite.
    """
    return hashlib.sha256(canonical_json(fields).encode()).hexdigest()


def canonical_json(value: Any) -> str:
    """The one JSON text of a value: equal values give equal texts."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def stage_fields(stage: str) -> dict[str, Any]:
    """Fields that every entry of a built-in stage starts with: schema, stage and its version.

    Raises:
        KeyError: a stage without a version in `STAGE_VERSIONS`.
    """
    return {"schema": SCHEMA, "stage": stage, "stage_version": STAGE_VERSIONS[stage]}


def file_digest(path: Path) -> str:
    """sha256 (64 hex digits) of a file's bytes.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def plugin_fields(plugin: type[Any]) -> dict[str, str]:
    """Name, version and code digest of a plugin class: any of them changing makes its users stale."""
    source = inspect.getsourcefile(plugin)
    if source is None:
        raise ValueError(f"plugin {plugin!r}: expected a class from a Python file, found no source")
    text = Path(source).read_text(encoding="utf-8")
    return {"name": plugin.name, "version": plugin.version, "code": code_digest(text)}


@lru_cache(maxsize=256)
def code_digest(source: str) -> str:
    """sha256 of Python source as a syntax tree without docstrings: comments and layout change nothing.

    Raises:
        SyntaxError: the source is not Python.
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [statement for statement in node.body if not _is_text(statement)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _is_text(statement: ast.stmt) -> bool:
    """Whether a statement is a bare string: a docstring, or a description under an attribute."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
