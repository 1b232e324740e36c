"""An import that fails for want of a system library names that library and how to install it."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest

from z2p_core.errors.missing_system_libraries import DEBIAN_PACKAGES, SystemLibraryError, explain_missing_libraries

SCRIPT = Path(__file__).parents[3] / "scripts" / "system_libraries.sh"


def test_a_missing_system_library_is_named_with_its_script() -> None:
    says = r"open3d loads .* libusb-9\.0\.so\.7, .*scripts/system_libraries\.sh"
    with pytest.raises(SystemLibraryError, match=says) as caught, explain_missing_libraries("open3d"):
        ctypes.CDLL("libusb-9.0.so.7")
    assert "\n" not in str(caught.value) and isinstance(caught.value, ImportError)


@pytest.mark.parametrize(
    "error", [ModuleNotFoundError("No module named 'a'"), ImportError("no name x"), OSError("disk"), ValueError("x.so")]
)
def test_other_errors_pass_unchanged(error: Exception) -> None:
    with pytest.raises(type(error)) as caught, explain_missing_libraries("open3d"):
        raise error
    assert caught.value is error


def test_the_message_and_the_script_name_the_same_packages() -> None:
    assert SCRIPT.is_file() and f'PACKAGES="{DEBIAN_PACKAGES}"' in SCRIPT.read_text()
