"""A package that cannot load one of the system's libraries is told by that library's name, with what to do."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest

from z2p_core.errors.missing_system_libraries import DEBIAN_PACKAGES, SystemLibraryError, explain_missing_libraries

SCRIPT = Path(__file__).parents[3] / "scripts" / "system_libraries.sh"


def test_a_library_that_is_not_there_is_named_with_the_script_that_brings_it() -> None:
    says = r"open3d loads .* libusb-9\.0\.so\.7, .*scripts/system_libraries\.sh"
    with pytest.raises(SystemLibraryError, match=says) as told, explain_missing_libraries("open3d"):
        ctypes.CDLL("libusb-9.0.so.7")
    assert "\n" not in str(told.value) and isinstance(told.value, ImportError)


@pytest.mark.parametrize(
    "error", [ModuleNotFoundError("No module named 'a'"), ImportError("no name x"), OSError("disk"), ValueError("x.so")]
)
def test_all_else_is_told_as_it_is(error: Exception) -> None:
    with pytest.raises(type(error)) as told, explain_missing_libraries("open3d"):
        raise error
    assert told.value is error


def test_what_the_message_says_is_what_the_script_installs() -> None:
    assert SCRIPT.is_file() and f'PACKAGES="{DEBIAN_PACKAGES}"' in SCRIPT.read_text()
