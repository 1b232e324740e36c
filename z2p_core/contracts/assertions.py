"""What the contract suite is made of: each raises AssertionError with what was expected and what came."""

from __future__ import annotations

import inspect
import json
from typing import Any

import numpy as np

from z2p_core import registry


def check_class(group: str, plugin: type[Any], interface: type[Any]) -> None:
    """None when the plugin class is whole: a subclass of its interface, named as its entry point is."""
    proper = inspect.isclass(plugin) and issubclass(plugin, interface)
    expect(proper, f"expected a subclass of {interface.__name__}, got {plugin!r}")
    missing = ", ".join(sorted(plugin.__abstractmethods__))
    expect(not missing, f"{plugin.__name__}: these methods of {interface.__name__} are missing: {missing}")
    for attribute in ("name", "version"):
        text = getattr(plugin, attribute, None)
        expect(isinstance(text, str) and text != "", f"{plugin.__name__}: {attribute} must be a text, got {text!r}")
    for entry in registry.installed(group):
        if entry.target == f"{plugin.__module__}:{plugin.__qualname__}":
            expect(entry.name == plugin.name, f"its name is {plugin.name!r}, its entry point's {entry.name!r}")


def check_array(array: Any, shape: tuple[int, ...], dtype: Any, what: str, finite: bool = True) -> None:
    """None when it is an array of that shape and dtype."""
    expect(isinstance(array, np.ndarray), f"{what}: expected a numpy array, got {type(array).__name__}")
    expect(array.shape == shape, f"{what}: expected shape {shape}, got {array.shape}")
    expect(array.dtype == dtype, f"{what}: expected {np.dtype(dtype)}, got {array.dtype}")
    expect(not finite or bool(np.isfinite(array).all()), f"{what}: expected finite numbers, got infinity or nan")


def same(array: np.ndarray, expected: np.ndarray, what: str) -> None:
    """None when both hold the same numbers."""
    expect(np.array_equal(array, expected, equal_nan=True), f"{what}: expected the same numbers, got others")


def refuses(call: Any, kind: type[Exception], what: str) -> None:
    """None when the call raises that kind of error, with a message."""
    try:
        result = call()
    except kind as error:
        expect(str(error) != "", f"{what}: {kind.__name__} has no message")
        return
    except Exception as error:
        raise AssertionError(f"{what}: expected {kind.__name__}, got {type(error).__name__}: {error}") from error
    raise AssertionError(f"{what}: expected {kind.__name__}, got {result!r}")


def plain_json(value: Any, what: str) -> str:
    """JSON text of plain finite numbers."""
    try:
        return json.dumps(value, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{what}: expected plain finite numbers for JSON, got {value!r}: {error}") from error


def expect(condition: bool, message: str) -> None:
    """None when the condition holds; else the message is raised."""
    if not condition:
        raise AssertionError(message)
