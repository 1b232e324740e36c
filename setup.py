"""Which folders become which packages: all but the core are installed under the one name ``z2p_renderer``."""

from setuptools import find_packages, setup

FOLDERS = ("pipeline", "plugins", "storage", "workflows")


def installed_packages() -> list[str]:
    """Names under which the folders of this checkout are installed."""
    packages = ["z2p_core", *(f"z2p_core.{name}" for name in find_packages("z2p_core")), "z2p_renderer"]
    for folder in FOLDERS:
        packages += [f"z2p_renderer.{folder}", *(f"z2p_renderer.{folder}.{name}" for name in find_packages(folder))]
    return packages


setup(
    packages=installed_packages(),
    package_dir={
        "": "shims", "z2p_core": "z2p_core", "z2p_renderer": "z2p_renderer",
        **{f"z2p_renderer.{folder}": folder for folder in FOLDERS},
    },
    py_modules=["workflows"],
)
