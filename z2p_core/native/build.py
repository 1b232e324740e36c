"""Compiles the kernels while z2p is installed, and notes the digest of their sources beside the library.

`pyproject.toml` names `BuildKernels` as setuptools' command. It runs before anything of z2p can be imported, so other
modules are run from their files.
"""

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

SOURCE_DIGEST = runpy.run_path(str(Path(__file__).with_name("source_digest.py")))
"""Names of the module `source_digest`."""
FLAGS = ["-O3", "-g0", "-fno-wrapv", "-fno-math-errno", "-fno-trapping-math"]
"""Compiler flags. They shape results, so they are part of results' fingerprints. Python's own flags have -fwrapv, with
which loops over int indices take a fifth longer."""
USUAL_COMPILERS = ("cc", "gcc", "clang")
"""Tried in this order where the compiler that Python was built with is not installed."""
INSTALL_ADVICE = (
    "install one (Debian, Ubuntu: apt-get install gcc libc6-dev; Fedora: dnf install gcc; macOS: xcode-select "
    "--install), or take a wheel of z2p, which needs none"
)


class BuildKernels(build_ext):
    """Compiles the kernels into a plain library that is not linked with Python, so one file serves every version."""

    def run(self) -> None:
        select_compiler()
        self.force = True  # setuptools notices changed C files, but not changed headers
        for extension in self.extensions:
            extension.extra_compile_args = FLAGS
        try:
            super().run()
        except (CCompilerError, ExecError) as error:
            sys.exit(f"z2p's kernels need a C compiler that works, and this one does not ({error}); {INSTALL_ADVICE}")
        for extension in self.extensions:
            library = Path(self.get_ext_fullpath(extension.name))
            note = library.with_name(SOURCE_DIGEST["NOTE_NAME"])
            note.write_text(SOURCE_DIGEST["source_digest"]() + "\n", encoding="utf-8")

    def get_ext_filename(self, fullname: str) -> str:
        return str(Path(*fullname.split(".")).with_name(SOURCE_DIGEST["LIBRARY_NAME"]))

    def get_export_symbols(self, ext: object) -> list[str]:
        return []  # setuptools would export the entry point of a Python module, which the library has not

    def get_libraries(self, ext: object) -> list[str]:
        return [] if os.name == "nt" else ["m"]


def select_compiler() -> None:
    """Sets the variable CC to a usual C compiler if it is empty and the one that Python was built with is missing.

    Ends the installation with one line that says what to install if there is no compiler, or not the one in CC.
    """
    user_choice = os.environ.get("CC")
    compiler = shlex.split(user_choice or sysconfig.get_config_var("CC") or USUAL_COMPILERS[0])[0]
    if os.name == "nt" or shutil.which(compiler):
        return
    substitute = None if user_choice else next(filter(shutil.which, USUAL_COMPILERS), None)
    if substitute is None:
        sys.exit(f"z2p's kernels need a C compiler, and there is no {compiler} here; {INSTALL_ADVICE}")
    os.environ["CC"] = substitute
