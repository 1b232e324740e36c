"""What a wheel of z2p is called: one serves every Python, for the kernels are a plain library that no Python is in."""

from __future__ import annotations

import re
import runpy
import shutil
import sys
import sysconfig
from pathlib import Path

from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.editable_wheel import editable_wheel

SOURCES, BUILD = (runpy.run_path(str(Path(__file__).with_name(name))) for name in ("source_digest.py", "build.py"))
OLDEST_GLIBC_MINOR = 17
"""The C library 2.17, of 2014, is the oldest that tools still speak of (manylinux2014); the kernels need 2.14."""


class NameWheel(bdist_wheel):
    """What ``tool.setuptools.cmdclass`` names; nothing of z2p can be imported yet."""

    def run(self) -> None:
        BUILD["find_compiler"]()  # before anything else is done and told
        built = self.get_finalized_command("build").build_lib
        shutil.rmtree(built, ignore_errors=True)  # all that lies there goes into the wheel, of earlier versions too
        super().run()

    def get_tag(self) -> tuple[str, str, str]:
        _, _, platform = super().get_tag()
        built = Path(self.bdist_dir, "z2p_core", "native", SOURCES["LIBRARY"])
        return "py3", "none", platform_tag(platform, built.read_bytes() if built.is_file() else b"")


class LinkedWheel(editable_wheel):
    """The same for ``pip install --editable``, whose wheel only says where the checkout is."""

    def run(self) -> None:
        BUILD["find_compiler"]()
        super().run()


def platform_tag(platform: str, library: bytes) -> str:
    """Name of the platforms where a compiled library runs: on Linux by the oldest GNU C library that has all it needs.

    Args:
        platform: what setuptools calls the machine that builds, such as ``linux_x86_64``.
        library: the file's bytes, in which every version of the C library that a symbol needs is spelled out.
    """
    needed = [int(minor) for minor in re.findall(rb"\0GLIBC_2\.(\d+)(?=[.\0])", library)]
    if sys.platform != "linux" or not needed:  # musl's, which has no versions
        return platform
    return f"manylinux_2_{max(OLDEST_GLIBC_MINOR, *needed)}_{sysconfig.get_platform().rpartition('-')[2]}"
