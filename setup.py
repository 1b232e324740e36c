"""Maps folders to installed packages: all but the core become parts of ``z2p_renderer``."""

from pathlib import Path

from setuptools import Extension, find_packages, setup

FOLDERS = ("pipeline", "plugins", "storage", "workflows")
KERNELS = Path("z2p_core/native/c")
"""C files, in a folder for each topic; `#include` names them relative to this folder."""
DATA = ("z2p_renderer.pipeline.templates", "z2p_renderer.storage.weights")
"""Folders without code; setuptools takes them for packages, and prints a long warning if they are not listed."""


def installed_packages() -> list[str]:
    """Names under which the folders of this checkout are installed."""
    packages = ["z2p_core", *(f"z2p_core.{name}" for name in find_packages("z2p_core")), "z2p_renderer"]
    for folder in FOLDERS:
        packages += [f"z2p_renderer.{folder}", *(f"z2p_renderer.{folder}.{name}" for name in find_packages(folder))]
    return [*packages, *DATA]


setup(
    packages=installed_packages(),
    package_dir={
        "": "shims", "z2p_core": "z2p_core", "z2p_renderer": "z2p_renderer",
        **{f"z2p_renderer.{folder}": folder for folder in FOLDERS},
    },
    py_modules=["workflows"],
    ext_modules=[Extension("z2p_core.native.kernels", sorted(map(str, KERNELS.glob("*/*.c"))),
                           include_dirs=[str(KERNELS)])],
)
