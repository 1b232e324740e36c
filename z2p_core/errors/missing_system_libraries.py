"""A failed import because of a missing system library: the message names the library and how to install it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from z2p_core.errors.messages import one_line

_LIBRARY_FILE = re.compile(r"[\w.+-]+\.(?:so(?:\.\d+)*|dylib|dll)\b")
DEBIAN_PACKAGES = "libusb-1.0-0 libgl1 libegl1 libx11-6"
"""The packages that scripts/system_libraries.sh installs."""


class SystemLibraryError(ImportError):
    """A Python package is installed, but a system library that it loads is not; the message says how to install it."""


@contextmanager
def explain_missing_libraries(package: str) -> Iterator[None]:
    """Context for the import of a package such as open3d, which loads system libraries that pip does not install.

    Raises:
        SystemLibraryError: a system library is missing. Other errors, ModuleNotFoundError included, pass unchanged.
    """
    try:
        yield
    except ModuleNotFoundError:
        raise
    except (ImportError, OSError) as error:
        library = _LIBRARY_FILE.search(str(error))
        if not library:
            raise
        raise SystemLibraryError(one_line(
            f"{package} loads the system library {library.group()}, which cannot be loaded here ({error}); in a clone "
            f"of z2p: sh scripts/system_libraries.sh (Debian, Ubuntu: apt-get install {DEBIAN_PACKAGES})"
        )) from error  # fmt: skip
