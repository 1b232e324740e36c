"""How an installation compiles the kernels: all of them anew, and with a note of what they come from."""

from __future__ import annotations

import runpy
from pathlib import Path

from setuptools.command.build_ext import build_ext

SOURCES = Path(__file__).with_name("sources.py")
FLAGS = ["-O3", "-g0", "-fno-wrapv", "-fno-math-errno", "-fno-trapping-math"]
"""For the compiler. They shape results, so they stand here, where fingerprints see them. Python's own have -fwrapv,
with which loops over int indices take a fifth longer."""


class BuildKernels(build_ext):
    """What ``tool.setuptools.cmdclass`` names; nothing of z2p can be imported yet."""

    def run(self) -> None:
        self.force = True  # setuptools would see a changed C file, but no changed header
        for extension in self.extensions:
            extension.extra_compile_args = FLAGS
        super().run()
        told = runpy.run_path(str(SOURCES))
        for extension in self.extensions:
            kernels = Path(self.get_ext_fullpath(extension.name))
            kernels.with_name(told["NOTE"]).write_text(told["digest"]() + "\n", encoding="utf-8")
