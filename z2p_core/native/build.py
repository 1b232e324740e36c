"""How an installation compiles the kernels: all of them anew, and with a note of what they come from."""

from __future__ import annotations

import os
import runpy
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

from setuptools.command.build_ext import build_ext
from setuptools.errors import CCompilerError, ExecError

TOLD = runpy.run_path(str(Path(__file__).with_name("source_digest.py")))
FLAGS = ["-O3", "-g0", "-fno-wrapv", "-fno-math-errno", "-fno-trapping-math"]
"""For the compiler. They shape results, so they stand here, where fingerprints see them. Python's own have -fwrapv,
with which loops over int indices take a fifth longer."""
USUAL = ("cc", "gcc", "clang")
INSTALL = (
    "install one (Debian, Ubuntu: apt-get install gcc libc6-dev; Fedora: dnf install gcc; macOS: xcode-select "
    "--install), or take a wheel of z2p, which needs none"
)


class BuildKernels(build_ext):
    """What ``tool.setuptools.cmdclass`` names; nothing of z2p can be imported yet.

    The kernels are a plain library, which no Python is linked with, so one file serves every Python.
    """

    def run(self) -> None:
        find_compiler()
        self.force = True  # setuptools would see a changed C file, but no changed header
        for extension in self.extensions:
            extension.extra_compile_args = FLAGS
        try:
            super().run()
        except (CCompilerError, ExecError) as error:
            sys.exit(f"z2p's kernels need a C compiler that works, and this one does not ({error}); {INSTALL}")
        for extension in self.extensions:
            kernels = Path(self.get_ext_fullpath(extension.name))
            kernels.with_name(TOLD["NOTE"]).write_text(TOLD["digest"]() + "\n", encoding="utf-8")

    def get_ext_filename(self, fullname: str) -> str:
        return str(Path(*fullname.split(".")).with_name(TOLD["LIBRARY"]))

    def get_export_symbols(self, ext: object) -> list[str]:
        return []  # nothing that a module of Python would have

    def get_libraries(self, ext: object) -> list[str]:
        return [] if os.name == "nt" else ["m"]


def find_compiler() -> None:
    """Sees that there is a C compiler: the one that the user or Python names, else a usual one instead of it.

    Ends the installation, in one line that says what to install, where there is none.
    """
    asked = os.environ.get("CC")
    named = shlex.split(asked or sysconfig.get_config_var("CC") or USUAL[0])[0]
    if os.name == "nt" or shutil.which(named):
        return
    other = None if asked else next(filter(shutil.which, USUAL), None)
    if other is None:
        sys.exit(f"z2p's kernels need a C compiler, and there is no {named} here; {INSTALL}")
    os.environ["CC"] = other  # Python was built elsewhere, by a compiler that is not here
