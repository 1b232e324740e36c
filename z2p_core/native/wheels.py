"""Names of z2p's wheels: one wheel serves every Python version, since the kernels are not linked with Python.

`pyproject.toml` names the classes as setuptools' commands. They run before anything of z2p can be imported, so other
modules are run from their files.
"""

from __future__ import annotations

import re
import runpy
import shutil
import sys
import sysconfig
from pathlib import Path

from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.editable_wheel import editable_wheel

LIBRARY_NAME = runpy.run_path(str(Path(__file__).with_name("source_digest.py")))["LIBRARY_NAME"]
select_compiler = runpy.run_path(str(Path(__file__).with_name("build.py")))["select_compiler"]
MIN_GLIBC_MINOR = 17
"""The GNU C library 2.17, of 2014, is the oldest that installers know (manylinux2014); the kernels need 2.14."""


class BuildWheel(bdist_wheel):
    """A wheel for every Python version on one platform."""

    def run(self) -> None:
        select_compiler()  # a missing compiler ends the build before anything else is done and printed
        build_folder = self.get_finalized_command("build").build_lib
        shutil.rmtree(build_folder, ignore_errors=True)  # all files in it enter the wheel, those of older builds too
        super().run()

    def get_tag(self) -> tuple[str, str, str]:
        _, _, platform = super().get_tag()
        library = Path(self.bdist_dir, "z2p_core", "native", LIBRARY_NAME)
        return "py3", "none", platform_tag(platform, library.read_bytes() if library.is_file() else b"")


class BuildEditableWheel(editable_wheel):
    """What ``pip install --editable`` builds: a wheel that only says where the checkout is."""

    def run(self) -> None:
        select_compiler()
        super().run()


def platform_tag(platform: str, library: bytes) -> str:
    """Name of the platforms that can run a compiled library: on Linux by the oldest GNU C library that suffices.

    Args:
        platform: setuptools' name of the building machine, such as ``linux_x86_64``.
        library: the file's bytes, which contain every version of the C library that a symbol needs.
    """
    minors = [int(minor) for minor in re.findall(rb"\0GLIBC_2\.(\d+)(?=[.\0])", library)]
    if sys.platform != "linux" or not minors:  # musl libc has no such versions
        return platform
    return f"manylinux_2_{max(MIN_GLIBC_MINOR, *minors)}_{sysconfig.get_platform().rpartition('-')[2]}"
