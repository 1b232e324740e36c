"""Rules of imports: which layers may import which, and where alone some libraries may be imported."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LAYERS = {
    "z2p_core": set(),
    "storage": {"z2p_core"},
    "pipeline": {"storage", "z2p_core"},
    "workflows": {"pipeline", "storage", "z2p_core"},
    "plugins": {"z2p_core"},
}
"""Layer -> the other layers that it may import."""
FOLDERS = set(LAYERS) - {"z2p_core"}
"""Layers that are packages of `z2p_renderer`."""
ONLY_IN = {
    "bpy": ("pipeline/blender.py", "pipeline/textured_blender.py"),
    "mathutils": "pipeline/blender.py",
    "luigi": "workflows/",
    "h5py": ("storage/", "plugins/readers/h5.py"),
}
"""Library -> where alone it may be imported."""
NOT_IN_CORE = {"h5py", "luigi", "bpy", "open3d"}
FILE_CALLS = {"open", "read_text", "write_text", "read_bytes", "write_bytes", "mkdir", "unlink", "touch", "rename"}
FILE_CALLS |= {"savez", "savez_compressed", "savetxt", "loadtxt", "genfromtxt", "fromfile", "tofile", "load_file"}
BUILDING = {Path("z2p_core/native", name) for name in ("build.py", "source_digest.py", "wheels.py")}
"""Modules that run while z2p is installed; setuptools is imported only there, and they read the C files."""
MAX_FOLDER_MODULES = 15
"""Modules in one source folder, without `__init__.py`."""


def sources(*layers: str) -> list[Path]:
    return sorted(path.relative_to(ROOT) for layer in layers for path in (ROOT / layer).rglob("*.py"))


def imports(path: Path) -> Iterator[tuple[str, int]]:
    """(full module name, line) of every import in a file, those inside functions included."""
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or ""), node.lineno
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("import_module", "__import__"):
            yield from ((str(name.value), node.lineno) for name in node.args if isinstance(name, ast.Constant))


ALL = sources(*LAYERS)


def test_the_checked_modules_are_found() -> None:
    assert {path.parts[0] for path in ALL} == set(LAYERS)
    assert "numpy" in [module for module, _ in imports(Path("z2p_core/placement/bounding_sphere.py"))]
    assert "bpy" in [module for module, _ in imports(Path("pipeline/blender.py"))]


@pytest.mark.parametrize("path", ALL, ids=str)
def test_imports_follow_the_arrows(path: Path) -> None:
    layer = path.parts[0]
    for module, line in imports(path):
        assert not module.startswith("."), f"{path}:{line}: relative import; write the whole name"
        target = module.removeprefix("z2p_renderer.").split(".")[0]
        assert target not in FOLDERS or module.startswith("z2p_renderer."), (
            f"{path}:{line}: {module} is installed as z2p_renderer.{module}")
        if target in LAYERS and target != layer:
            allowed = ", ".join(sorted(LAYERS[layer])) or "no other layer"
            assert target in LAYERS[layer], f"{path}:{line} imports {module}; {layer} may import {allowed}"
        home = ONLY_IN.get(target)
        assert home is None or str(path).startswith(home), f"{path}:{line} imports {target}, which belongs in {home}"


@pytest.mark.parametrize("path", sources("pipeline", "storage", "workflows", "z2p_core"), ids=str)
def test_nobody_imports_plugins(path: Path) -> None:
    lines = [line for module, line in imports(path) if module.startswith("z2p_renderer.plugins")]
    assert not lines, f"{path}:{lines[0]} imports plugins; use z2p_core.registry.load"


@pytest.mark.parametrize("path", sorted({*sources("z2p_core")} - BUILDING), ids=str)
def test_the_core_touches_no_file(path: Path) -> None:
    for module, line in imports(path):
        assert module.split(".")[0] not in NOT_IN_CORE, f"{path}:{line}: the core may not import {module}"
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Call):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            assert called not in FILE_CALLS, f"{path}:{node.lineno} calls {called}: files belong in storage"


def test_no_two_test_files_have_one_name() -> None:
    """As there are no packages, pytest imports them by it."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def package_of(module: str) -> str:
    """Package, or single module, of `pipeline/` that a module's dotted name without `z2p_renderer.` lies in."""
    return module.split(".")[1]


def test_packages_of_the_pipeline_have_no_circle() -> None:
    """Imports inside functions included."""
    edges: dict[str, set[str]] = {}
    for path in sources("pipeline"):
        package = path.parts[1].removesuffix(".py")
        targets = {module.removeprefix("z2p_renderer.") for module, _ in imports(path)}
        edges.setdefault(package, set()).update(
            package_of(target) for target in targets if target.startswith("pipeline.")
        )
    remaining = {package: targets - {package} for package, targets in edges.items()}
    while leaves := [package for package, targets in remaining.items() if not targets & set(remaining)]:
        for package in leaves:
            del remaining[package]
    assert not remaining, f"packages import one another in a circle: {sorted(remaining)}"


def imported_modules(path: Path) -> set[str]:
    """Names of our own modules, without `z2p_renderer.`, that a file imports, those inside functions included."""
    names = {module for module, _ in imports(path)}
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.ImportFrom):
            members = {f"{node.module}.{alias.name}".removeprefix("z2p_renderer.") for alias in node.names}
            if members <= set(MODULES):  # modules of a package, and nothing of the package itself
                names = names - {node.module} | members
    return {name.removeprefix("z2p_renderer.") for name in names} & set(MODULES)


MODULES = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): path for path in ALL}
"""Dotted name of a module without `z2p_renderer.` -> its file."""


def modules_in_circles(edges: dict[str, set[str]]) -> set[str]:
    """Modules that import one another in a circle, and those between two circles."""
    remaining = set(edges)
    importers = {name: {other for other in edges if name in edges[other]} for name in edges}
    while acyclic := {name for name in remaining if not edges[name] & remaining or not importers[name] & remaining}:
        remaining -= acyclic
    return remaining


def test_circles_of_imports_are_detected() -> None:
    edges = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}
    assert modules_in_circles(edges) == {"b", "c"}


@pytest.mark.slow
def test_no_modules_import_one_another_in_a_circle() -> None:
    """An import inside a function counts as well: it only hides a circle."""
    edges = {name: imported_modules(path) - {name} for name, path in MODULES.items()}
    assert "storage.results.store" in edges["storage.results.adoption"]
    assert not modules_in_circles(edges)


def test_no_source_folder_has_too_many_modules() -> None:
    counts = Counter(path.parent for path in ALL if path.name != "__init__.py")
    assert {str(folder): count for folder, count in counts.items() if count > MAX_FOLDER_MODULES} == {}
