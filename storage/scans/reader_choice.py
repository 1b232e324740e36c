"""Chooses the reader plugin for a file by its suffix."""

from __future__ import annotations

from pathlib import Path

from z2p_core import registry
from z2p_core.interfaces import Reader, ScanError
from z2p_renderer.storage.files.printable_names import without_gz
from z2p_renderer.storage.scans.unsupported_formats import advice_by_content, advice_by_suffix

BUILTIN_SUFFIXES = {
    "e57": (".e57",),
    "h5": (".h5", ".hdf5"),
    "las": (".las", ".laz"),
    "meshes": (".stl", ".glb", ".gltf"),
    "numpy": (".npy", ".npz"),
    "pcd": (".pcd",),
    "ply": (".ply",),
    "ptx": (".ptx",),
    "sweeps": (".bin",),
    "text": (".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv", ".tsv"),
    "vertices": (".obj", ".off"),
    "vtk": (".vtk", ".vtp", ".vtu"),
}
"""Suffixes of the built-in readers, so that only the reader of a file is imported; a reader that is missing here is
imported for every file."""


def readable_suffixes() -> dict[str, str]:
    """Suffix, lower-case with its dot -> name of its reader; readers that fail to load are left out."""
    return {suffix: names[0] for suffix, names in sorted(_collect_claims()[0].items())}


def format_suffix(path: Path) -> str:
    """Suffix of a file's format, lower-case with its dot: that before .gz, if it is gzip'd."""
    return without_gz(path).suffix.lower()


def reader_for(path: Path) -> Reader:
    """A new instance of the reader for a file of that name.

    Raises:
        ScanError: no reader claims its suffix, or several do.
    """
    suffix = format_suffix(path)
    claims, faults = _collect_claims(suffix)
    if suffix not in claims:
        claims, faults = _collect_claims()
    names = claims.get(suffix, [])
    if not names:
        if advice := advice_by_suffix(path) or advice_by_content(path, suffix):
            raise ScanError(advice)
        broken = f" ({'; '.join(faults)})" if faults else ""
        raise ScanError(f"no reader for {suffix or 'a file without suffix'!r}; readable: "
                        f"{', '.join(sorted(claims))}{broken}; a text with a point a line is read as .txt")
    if len(names) > 1:
        raise ScanError(f"{suffix} is claimed by the readers {' and '.join(names)}; uninstall one of them")
    return registry.load("readers", names[0])()


def _collect_claims(wanted: str | None = None) -> tuple[dict[str, list[str]], list[str]]:
    """Suffix -> names of the readers that claim it, and the errors of readers that fail to load.

    If only one suffix is `wanted`, built-in readers that are known to have others are not imported: importing them all
    takes longer than running the network.
    """
    claims: dict[str, list[str]] = {}
    faults = []
    for name in registry.names("readers"):
        is_other_suffix = wanted is not None and wanted not in BUILTIN_SUFFIXES.get(name, (wanted,))
        if is_other_suffix and registry.is_builtin("readers", name):
            continue
        try:
            plugin = registry.load("readers", name)
        except registry.PluginError as error:
            faults.append(str(error))
            continue
        for suffix in plugin.suffixes:
            claims.setdefault(suffix, []).append(name)
    return claims, faults
