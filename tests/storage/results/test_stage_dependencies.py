"""The fingerprint of a stage holds all code that it imports, except what is excused by name."""

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest

import z2p_renderer.storage.results.fingerprints
from z2p_core import registry
from z2p_renderer.storage.results.c_code_digest import c_digest
from z2p_renderer.storage.results.code_digest import (
    cached_part_digest,
    code_digest,
    defined_names,
    list_imports,
    module_file,
)
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS, file_digest, plugin_fields, stage_fields
from z2p_renderer.storage.results.stage_dependencies import (
    NOT_IN_FINGERPRINT,
    PACKAGES,
    PLACEMENT_CODE,
    STAGE_CODE,
    WEIGHTS_ONLY_CODE,
    WHOLE_PACKAGES,
    installed_version,
)

ROOT = Path(__file__).parents[3]
PAPER = "pipeline.evaluation.paper"
TOP_FOLDERS = {"z2p_core", "storage", "pipeline", "plugins", "workflows"}
ENTRY = {
    "shapes": {"workflows.stages:Shapes", "pipeline.shapes:make_shapes", "pipeline.blender:export_suzanne"},
    "sample": {"workflows.stages:SampleMesh", "pipeline.rendering.mesh_samples:sample_pool"},
    "render": {"workflows.stages:RenderChunk", "pipeline.rendering.views:render_chunk", "pipeline.blender:main"},
    "textured_render": {"workflows.stages:TexturedRenderChunk", "pipeline.textured_blender:main",
                        "pipeline.rendering.textured_views:render_textured_chunk", "pipeline.blender:main"},
    "shard": {"workflows.stages:ShardMesh", "pipeline.training.make_shard:make_shard"},
    "train": {"workflows.stages:Train", "pipeline.training.train:train"},
    "reference": {"pipeline.rendering.ground_truth:render_references", "pipeline.blender:main"},
    "textured": {"pipeline.rendering.textured_truth:render_textured_references", "pipeline.textured_blender:main"},
    "evaluate": {"workflows.stages:Evaluate", "pipeline.evaluation.evaluate:evaluate", "pipeline.blender:main",
                 "pipeline.textured_blender:main"},
    "measure": {"workflows.report.stages:Measure", f"{PAPER}.measure:measure", "pipeline.blender:main",
                "pipeline.textured_blender:main"},
    "scans": {"workflows.report.stages:Scans", f"{PAPER}.real_scans:draw_scans", "pipeline.blender:main",
              "pipeline.textured_blender:main"},
    "times": {"workflows.report.stages:Times", f"{PAPER}.timing:measure_times", "pipeline.blender:main",
              "pipeline.textured_blender:main"},
    "trust": {"workflows.report.stages:Trust", f"{PAPER}.uncertainty:measure_uncertainty", "pipeline.blender:main",
              "pipeline.textured_blender:main"},
    "report": {"workflows.report.stages:Report", f"{PAPER}.page.report:write_report"},
    "compare": {"workflows.ablation.stages:Compare", "pipeline.evaluation.ablation.page:write_ablations"},
}
"""Stage -> its luigi task, the function that this calls, and what its Blender process runs."""
PLUGINS = {
    "sample": {"samplers"},
    "render": {"controls"},
    "textured_render": {"controls", "textures"},
    "shard": {"controls"},
    "textured": {"textures"},
    "train": {"zbuffers", "gbuffers", "conditions", "encoders", "controls", "textures"},
    "evaluate": {"zbuffers", "gbuffers", "conditions", "encoders", "controls", "samplers", "engines", "textures"},
    "measure": {"zbuffers", "gbuffers", "encoders", "controls", "samplers", "engines", "baselines", "painters",
                "textures"},
    "scans": {"zbuffers", "gbuffers", "encoders", "controls", "samplers", "engines", "baselines", "painters",
              "readers"},
    "times": {"zbuffers", "gbuffers", "encoders", "controls", "samplers", "engines", "baselines", "painters"},
    "trust": {"zbuffers", "gbuffers", "encoders", "controls", "samplers", "engines"},
}
DISTRIBUTIONS = {"trimesh": "trimesh", "bpy": "bpy", "h5py": "h5py", "torch": "torch", "kornia": "kornia",
                 "flip_evaluator": "flip-evaluator", "numpy": "numpy", "open3d": "open3d"}  # fmt: skip
READERS = {("train", "h5py"), ("evaluate", "h5py")}
"""Packages with which a stage only reads what another one wrote."""

def listed(stage: str, module: str, name: str) -> bool:
    parts = STAGE_CODE[stage]
    return module in parts or (bool(name) and f"{module}:{name}" in parts)


def excused(stage: str, module: str, name: str) -> bool:
    counts_somewhere = any(f"{module}:{name}" in parts for parts in STAGE_CODE.values())
    return f"{stage}/{module}:{name}" in NOT_IN_FINGERPRINT or (module in NOT_IN_FINGERPRINT and not counts_somewhere)


def needs(part: str) -> Iterator[tuple[str, str]]:
    """(module, name) of what a part uses: imports, and for a definition also its module's other definitions."""
    if "/" in part:
        return
    module, _, definition = part.partition(":")
    tree = ast.parse(module_file(module).read_text())
    if not definition:
        yield from list_imports(tree)
        return
    body = ast.Module([one for one in tree.body if definition in defined_names(one)], [])
    used = {node.id for node in ast.walk(body) if isinstance(node, ast.Name)} - {definition}
    here = set().union(*(defined_names(one) for one in tree.body))
    yield from ((module, name) for name in used & here if name != "Value" and not name.endswith("Error"))
    yield from list_imports(body)
    for origin, name in list_imports(ast.Module([one for one in tree.body if not defined_names(one)], [])):
        if name in used or origin in used:
            yield origin, name


def as_listed(module: str) -> str:
    """A module's name as in a checkout."""
    return module.removeprefix("z2p_renderer.")


@cache
def needed(part: str) -> frozenset[tuple[str, str]]:
    """What a part needs of the project's own, with ``from package import module`` told as that module."""
    kept = {(as_listed(module), name) for module, name in needs(part) if as_listed(module).split(".")[0] in TOP_FOLDERS}
    inner = {(m, n): (f"{m}.{n}", "") for m, n in kept if n and module_file(f"{m}.{n}").is_file()}
    return frozenset(inner.get(one, one) for one in kept)


def plugins(stage: str) -> list[type]:
    found = [registry.load(group, name) for group in PLUGINS.get(stage, ()) for name in registry.names(group)]
    return [plugin for plugin in found if plugin.__module__.startswith("z2p_renderer.plugins.")]


def plugin_modules(stage: str) -> set[str]:
    """Those of the stage's plugins, and what they import of their own folder: all of it is in the plugins' digests."""
    found, waiting = set(), {as_listed(plugin.__module__) for plugin in plugins(stage)}
    while waiting:
        found.add(module := waiting.pop())
        waiting |= {other for other, _ in needed(module) if other.startswith("plugins.")} - found
    return found


def packages(part: str) -> set[str]:
    """Distributions whose code a part calls, as far as any stage declares them."""
    return {DISTRIBUTIONS[name] for name in {module.split(".")[0] for module, _ in needs(part)} & set(DISTRIBUTIONS)}


@pytest.mark.parametrize("stage", STAGE_CODE)
def test_all_imports_of_a_stage_are_listed_or_excused(stage):
    for part in ENTRY[stage]:
        assert listed(stage, *part.split(":")), f"{stage} runs {part}, which its fingerprint does not hold"
    for part in [*STAGE_CODE[stage], *plugin_modules(stage)]:
        for module, name in needed(part) - {(one, "") for one in ("plugins",)}:
            if module in plugin_modules(stage) or module == "z2p_core":
                continue
            assert listed(stage, module, name) or excused(stage, module, name), (
                f"{stage}: {part} uses {module}:{name}, which is neither in STAGE_CODE[{stage!r}] nor in "
                "NOT_IN_FINGERPRINT")


@pytest.mark.parametrize("stage", STAGE_CODE)
def test_no_part_is_listed_that_the_stage_never_imports(stage):
    reached, waiting = set(), [*ENTRY[stage], *plugin_modules(stage)]
    while waiting:
        part = waiting.pop()
        module = part.split(":")[0]
        for step in ({part} & plugin_modules(stage)) | ({part, module} & set(STAGE_CODE[stage])):
            if step not in reached:
                reached.add(step)
                waiting += [f"{origin}:{name}" if name else origin for origin, name in needed(step)]
    by_package = {part for part in STAGE_CODE[stage] if (package := part.rpartition(".")[0]) in WHOLE_PACKAGES
              and any(module == package or module.startswith(package + ".") for module in reached)}  # fmt: skip
    by_package |= {part for part in WHOLE_PACKAGES if any(module.startswith(part + ".") for module in reached)}
    files = {part for part in STAGE_CODE[stage] if "/" in part}
    compiled = {file for file in files if file.rpartition("/")[0].replace("/", ".") in reached}
    compiled |= {file for file in files if file.startswith("z2p_core/native/") and "z2p_core.native" in reached}
    assert set(STAGE_CODE[stage]) <= reached | compiled | by_package


@pytest.mark.parametrize("stage", STAGE_CODE)
def test_packages_that_a_stage_imports_are_declared(stage):
    used = {package for part in STAGE_CODE[stage] for package in packages(part)}
    for plugin in plugins(stage):  # what it names itself is in its own fields
        used |= packages(plugin.__module__) - set(getattr(plugin, "packages", ()))
    assert {package for package in used if (stage, package) not in READERS} <= set(PACKAGES[stage])
    project = (ROOT / "pyproject.toml").read_text()
    assert all(re.search(rf'"{package}[>=]', project) for package in PACKAGES[stage])


def test_placement_code_is_not_dropped_for_baselines():
    reached, waiting = set(), {"pipeline.placement.place_scan"}
    while waiting:
        part = waiting.pop()
        reached.add(part)
        if part != "z2p_core.native":  # its names come from modules that placing does not all call
            waiting |= {module for module, _ in needed(part)} - reached
    assert reached & set(WEIGHTS_ONLY_CODE) <= set(PLACEMENT_CODE) <= set(WEIGHTS_ONLY_CODE) & set(STAGE_CODE["scans"])
    kernels = {name: set(re.findall(r"native\.(\w+)", (ROOT / "z2p_core" / f"{name}.py").read_text()))
               for name in ("placement/view_selection", "surface/mls_smoothing")}  # fmt: skip
    assert kernels == {
        "placement/view_selection": {"projected_coverage"},
        "surface/mls_smoothing": {"NeighborGrid", "fit_jets", "fit_planes"},
    }


def test_a_package_may_come_by_another_name(monkeypatch):
    versions = {"open3d-cpu": "0.19.0", "numpy": "1.26.4"}

    def version(name):
        if name not in versions:
            raise metadata.PackageNotFoundError(name)
        return versions[name]

    monkeypatch.setattr(metadata, "version", version)
    installed = installed_version.__wrapped__
    assert [installed(name) for name in ("open3d", "numpy", "torch")] == ["0.19.0", "1.26.4", "not installed"]
    versions["open3d"] = "0.20.0+abc"
    assert installed("open3d") == "0.20.0"


def test_every_excuse_is_needed_and_every_stage_is_listed():
    assert set(STAGE_CODE) == set(PACKAGES) == set(STAGE_VERSIONS) == set(ENTRY)
    used = {one for stage in STAGE_CODE for part in [*STAGE_CODE[stage], *plugin_modules(stage)] for m, n in
            needed(part) for one in (m, f"{stage}/{m}:{n}")}  # fmt: skip
    assert set(NOT_IN_FINGERPRINT) <= used


def test_all_listed_parts_exist():
    for stage in STAGE_CODE:
        assert all(len(digest) == 64 for digest in stage_fields(stage)["code"].values())


def test_c_files_and_compiler_flags_are_listed():
    kinds = ("c", "cpp", "h", "cu", "pyx")
    sources = [path for folder in TOP_FOLDERS for kind in kinds for path in (ROOT / folder).rglob(f"*.{kind}")]
    listed_files = {part for parts in STAGE_CODE.values() for part in parts if "/" in part}
    built_with = ROOT / "z2p_core" / "native" / "build.py"  # the compiler's flags, which no module imports
    assert {path.relative_to(ROOT).as_posix() for path in [*sources, built_with]} == listed_files
    assert cached_part_digest("workflows/luigi.cfg") == file_digest(ROOT / "workflows" / "luigi.cfg")


C = '''#include <math.h>
#define TWICE(x) ((x) + (x))  /* no comment */
// what it is
static const char *told = "/* no comment */ // 'none' \\" ", quote = '"';

float half(float a, int b) { return a - -b / 2; }
'''


@pytest.mark.parametrize(
    "old, new",
    [
        ("// what it is\n", ""),
        ("// what it is", "/* it is\n\n   what */ // \"and\" 'more"),
        ("/* no comment */\n//", "// 'another\n\n//"),
        ("{ return", "{\n\t/* half */ return"),
        ("a - -b / 2", "a-\n-b/2"),
        ("(x) + (x))", "(x) \\\n    + (x))"),
        ("\n", "\r\n"),
    ],
)
def test_comments_and_layout_of_c_make_nothing_stale(old, new):
    assert old in C and c_digest(C.replace(old, new)) == c_digest(C)


@pytest.mark.parametrize(
    "old, new",
    [
        ("<math.h>", "<math//.h>"),
        ("told = \"/* no", "told = \"/*  no"),
        ("// 'none'", "// 'nine'"),
        ("'\"'", "'\\''"),
        ("a - -b", "a --b"),
        ("a - -b", "a - +b"),
        ("b / 2", "b // 2"),
        ("TWICE(x)", "TWICE (x)"),
        ("+ (x))", "+\n(x))"),
        ("int b", "intb"),
        ("half", "Half"),
    ],
)
def test_any_other_change_of_c_changes_the_digest(old, new):
    assert old in C and c_digest(C.replace(old, new)) != c_digest(C)


def test_code_of_each_kernel_counts_and_comments_do_not():
    for part in {part for part in STAGE_CODE["train"] if part.endswith((".c", ".h"))}:
        source = (ROOT / part).read_text()
        assert cached_part_digest(part) == c_digest(f"/* new */\n{source}\n\n// new\n")
        assert cached_part_digest(part) != c_digest(f"{source}\nint new;\n")


def test_digest_of_a_definition_ignores_the_rest_of_its_module():
    text = "A = 1\ndef f():\n    return A\ndef g():\n    return 2\n"
    assert code_digest(text, "f") == code_digest(text.replace("2", "3"), "f") != code_digest(text, "g")
    assert code_digest(text, "A") != code_digest(text.replace("A = 1", "A = 2"), "A")
    with pytest.raises(ValueError, match="'h'"):
        code_digest(text, "h")


def test_stage_fields_hold_code_and_packages_without_builds():
    fields = stage_fields("train")
    assert fields["code"]["pipeline.training.train"] == cached_part_digest("pipeline.training.train")
    assert fields["packages"]["torch"] and "+" not in fields["packages"]["torch"]


def test_a_plugins_code_is_that_of_its_whole_package(tmp_path, monkeypatch):
    package = tmp_path / "coded_plugin"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "strength.py").write_text("STRENGTH = 2\n")
    (package / "control.py").write_text("from .strength import STRENGTH\nclass Gloss:\n    name, version = 'g', '1'\n")
    (package / "other.py").write_text("X = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    plugin = __import__("coded_plugin.control", fromlist=["Gloss"]).Gloss
    before = plugin_fields(plugin)
    (package / "other.py").write_text("X = 2\n")
    (package / "strength.py").write_text("STRENGTH = 2  # as ever\n")
    assert plugin_fields(plugin) == before
    (package / "strength.py").write_text("STRENGTH = 3\n")
    assert plugin_fields(plugin)["code"] != before["code"]


def test_a_plugin_becomes_stale_with_the_packages_that_it_names(monkeypatch):
    farthest, uniform = (registry.load("samplers", name) for name in ("farthest", "uniform"))
    before = [plugin_fields(plugin) for plugin in (farthest, uniform)]
    later = z2p_renderer.storage.results.fingerprints
    monkeypatch.setattr(later, "installed_version", lambda package: f"{package} of tomorrow")
    assert plugin_fields(farthest)["code"] != before[0]["code"]
    assert plugin_fields(uniform) == before[1]


@pytest.mark.parametrize("where", ["packed_plugin", "packed_plugin.deep"])
@pytest.mark.parametrize("line", ["from .values import X", "from . import values", "from {0}.values import X"])
def test_a_plugin_may_live_in_its_packages_init(tmp_path, monkeypatch, where, line):
    folder = tmp_path.joinpath(*where.split("."))
    (folder / "values").mkdir(parents=True)
    if "." in where:
        (folder.parent / "__init__.py").write_text("")
    (folder / "__init__.py").write_text(f"{line.format(where)}\nclass Gloss:\n    name, version = 'g', '1'\n")
    values = folder / "values" / "__init__.py"  # a package itself, whose parts count as well
    values.write_text("from .numbers import X\n")
    (folder / "values" / "numbers.py").write_text("X = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.startswith("packed_plugin")]:
        monkeypatch.delitem(sys.modules, name)
    plugin = __import__(where, fromlist=["Gloss"]).Gloss
    before = plugin_fields(plugin)
    (folder / "values" / "numbers.py").write_text("X = 2\n")
    assert plugin_fields(plugin) != before


