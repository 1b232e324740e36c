"""What to do where a package cannot be loaded for want of one of the system's own libraries."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from z2p_core.errors.messages import one_line

_FILE = re.compile(r"[\w.+-]+\.(?:so(?:\.\d+)*|dylib|dll)\b")
DEBIAN_PACKAGES = "libusb-1.0-0 libgl1 libegl1 libx11-6"
"""What scripts/system_libraries.sh installs."""


class SystemLibraryError(ImportError):
    """A package is installed, and a library that it loads is not; the message names it and says how to get it."""


@contextmanager
def explain_missing_libraries(package: str) -> Iterator[None]:
    """Around the import of a package such as open3d, which loads libraries that pip does not bring.

    Raises:
        SystemLibraryError: one of them is missing.
    """
    try:
        yield
    except ModuleNotFoundError:
        raise
    except (ImportError, OSError) as error:
        named = _FILE.search(str(error))
        if not named:
            raise
        raise SystemLibraryError(one_line(
            f"{package} loads the system library {named.group()}, which cannot be loaded here ({error}); in a clone of "
            f"z2p: sh scripts/system_libraries.sh (Debian, Ubuntu: apt-get install {DEBIAN_PACKAGES})"
        )) from error  # fmt: skip
