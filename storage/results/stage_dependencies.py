"""Which code and which packages each stage's result depends on: their digests and versions enter its fingerprint.

How to read the tables: `STAGE_CODE` maps a stage to its parts. A part is one of

- ``package.module``: a whole module, such as ``pipeline.render``;
- ``package.module:definition``: one top-level definition, where the rest of the module does not matter;
- ``folder/file.c``: a file that no Python module imports (C code, the compiler's flags).

Groups of parts that several stages need have names (`_RENDERER`, `_KERNELS`, ...). Of the `WHOLE_PACKAGES` all modules
are listed, by `modules_in`: a few more results become stale, but new files in them need no entry here.

A part's digest covers its syntax tree without docstrings (C: its tokens), so comments and layout make nothing stale; of
other files every byte counts. The tables are written by hand and checked by tests/storage/results/
test_stage_dependencies.py: whatever the code of a stage imports is in `STAGE_CODE` or, with the reason, in
`NOT_IN_FINGERPRINT`.

After a change that leaves the results the same (a refactoring), `z2p adopt` takes the old results over at no cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from importlib import metadata

from z2p_renderer.storage.results.code_digest import CORE_FOLDER, cached_part_digest, current_part_digest, module_file

WHOLE_PACKAGES = (
    "z2p_core.native", "z2p_core.network", "z2p_core.shading", "z2p_core.surface", "z2p_core.placement",
    "z2p_core.up_axis", "z2p_core.formats", "z2p_core.formats.arrays", "z2p_core.formats.tables", "storage.scans",
    "pipeline.placement",
)
"""Packages whose modules change together: a stage that needs one of them lists all."""


def modules_in(package: str) -> tuple[str, ...]:
    """Names of the package's own module and of its modules, but not of packages below it."""
    assert package in WHOLE_PACKAGES
    folder = module_file(package).parent
    return (package, *(f"{package}.{path.stem}" for path in sorted(folder.glob("[!_]*.py"))
                       if f"{package}.{path.stem}" not in BUILD_MODULES))  # fmt: skip


def c_files_below(folder: str) -> tuple[str, ...]:
    """Parts for all C files in the direct subfolders of `folder`, a path below the project's root."""
    root = CORE_FOLDER.parent
    return tuple(path.relative_to(root).as_posix() for path in sorted((root / folder).glob("*/*.[ch]")))


BUILD_MODULES = ("z2p_core.native.build", "z2p_core.native.source_digest", "z2p_core.native.wheels")
"""Modules that no stage imports: they compile the kernels and name wheels. `_KERNELS` lists build.py by its path."""
_CONTROLS = ("z2p_core.interfaces:Control", "z2p_core.interfaces:Slider", "z2p_core.settings", "z2p_core.scene")
_RANDOM_ROTATION = ("z2p_core.rotations:random_rotation", "z2p_core.rotations:quaternion_rotations")
_MESHES = ("storage.meshes", "z2p_core.formats.ply_header")
_RENDERS = (
    "pipeline.render", "pipeline.blender", "z2p_core.camera", "z2p_core.placement.bounding_sphere", "z2p_core.images",
    *_MESHES,
)
_TEXTURED_RENDERS = (
    "pipeline.rendering.textured_meshes", "pipeline.rendering.textures", "pipeline.textured_blender",
    "z2p_core.meshes.subdivision",
)
"""What renders of meshes with colors of their own depend on, beside `_RENDERS`."""
_KERNELS = (*modules_in("z2p_core.native"), "z2p_core/native/build.py", *c_files_below("z2p_core/native/c"))
_BUFFERS_AND_NETWORK = (
    "pipeline.inference.input_buffers", "pipeline.inference.loading", "storage.models.checkpoints",
    "z2p_core.splatting", "z2p_core.parallel", "z2p_core.linalg", *modules_in("z2p_core.network"),
    *modules_in("z2p_core.shading"), *modules_in("z2p_core.surface"), *_KERNELS,
)
_EXPORTED_FILES = ("storage.models.onnx_files", "storage.models.onnx_deltas", "storage.models.engine_cache")
_RENDERER = (
    "pipeline.inference.renderer", "pipeline.inference.adaptive_resolution", "pipeline.inference.engine_selection",
    *_EXPORTED_FILES,
)
_NETWORK = ("z2p_core.camera", "z2p_core.scene", *_BUFFERS_AND_NETWORK)

WEIGHTS_ONLY_CODE = (*_RENDERER, *_BUFFERS_AND_NETWORK)
"""Parts that only methods with weights run. A report's baselines and ground truth do not depend on them."""
PLACEMENT_CODE = (
    "z2p_core.parallel", "z2p_core.linalg", *modules_in("z2p_core.surface"), "z2p_core.native",
    *(f"z2p_core.native.{name}" for name in ("library", "images", "points")),
    *(part for part in _KERNELS if part.startswith(("z2p_core/native/c/points/", "z2p_core/native/c/common/"))),
)
"""The parts of `WEIGHTS_ONLY_CODE` that placing a scan runs as well, so every method depends on them for scans."""
_CASES = (
    *(f"pipeline.evaluation.paper.cases.{name}" for name in ("sweeps", "synthetic_scans", "synthetic_shapes",
                                                              "ground_truth")),
    "pipeline.evaluation.paper.methods", "pipeline.evaluation.baselines", "pipeline.rendering.textured_truth",
    *_TEXTURED_RENDERS,
    *(f"pipeline.evaluation.evaluate:{name}" for name in ("sample_views", "UPRIGHT_SHARE")),
    "pipeline.rendering.mesh_samples:sample_cloud", "pipeline.rendering.ground_truth", "pipeline.rendering.views",
    *_RANDOM_ROTATION,
    "pipeline.shapes", "z2p_core.meshes.synthetic_noise",
    "z2p_core.meshes.triangle_sampling", *_RENDERER, *_RENDERS, *_NETWORK, *_CONTROLS,
)
_PAPER = "pipeline.evaluation.paper"

STAGE_CODE: dict[str, tuple[str, ...]] = {
    "shapes": (
        "workflows.stages:Shapes", "pipeline.shapes", "pipeline.render:export_suzanne", "pipeline.render:_run_blender",
        "pipeline.blender:export_suzanne", "storage.meshes:write_mesh", "storage.meshes:_vertex_block",
    ),
    "sample": (
        "workflows.stages:SampleMesh", "pipeline.rendering.mesh_samples", "z2p_core.placement.bounding_sphere",
        "z2p_core.meshes.synthetic_noise", "z2p_core.meshes.triangle_sampling", *_MESHES,
    ),
    "render": (
        "workflows.stages:RenderChunk", "pipeline.rendering.views", *_RANDOM_ROTATION, *_RENDERS,
        *_CONTROLS,
    ),
    "textured_render": (
        "workflows.stages:TexturedRenderChunk", "pipeline.rendering.textured_views", "pipeline.rendering.views",
        *_TEXTURED_RENDERS, *_RANDOM_ROTATION, *_RENDERS, *_CONTROLS,
    ),
    "shard": (
        "workflows.stages:ShardMesh", "pipeline.training.make_shard", "pipeline.rendering.views:load_controls",
        "storage.shards", "z2p_core.images", *_CONTROLS,
    ),
    "train": (
        "workflows.stages:Train",
        *(f"pipeline.training.{name}" for name in ("train", "state", "dataset", "augment", "distillation", "cropping",
                                                   "learning_curve", "shadow_debias", "textured_samples")),
        "pipeline.rendering.textures", *(part for part in _CONTROLS if part != "z2p_core.scene"),
        "pipeline.training.make_shard:downsample_images", "pipeline.export", "pipeline.export.fp16_constants",
        "pipeline.inference.engine_selection", *_EXPORTED_FILES, "storage.shards",
        "z2p_core.config.pipeline:batch_size", "z2p_core.config.pipeline:samples_until", "z2p_core.images",
        *_RANDOM_ROTATION,
        *(f"z2p_core.quality.{name}" for name in ("flip_loss", "losses", "metrics:PIXELS_PER_DEGREE",
                                                  "metrics:SSIM_WINDOW", "metrics:FOREGROUND_COVERAGE",
                                                  "separable_filter", "validation_metrics")),
        "z2p_core.meshes.synthetic_noise", *_NETWORK,
    ),
    "evaluate": (
        "workflows.stages:Evaluate", "pipeline.evaluation.evaluate", "pipeline.evaluation.baselines:with_true_floor",
        "pipeline.evaluation.comparison_sheet", "pipeline.outputs.point_preview", "pipeline.rendering.textured_truth",
        *_TEXTURED_RENDERS,
        *(f"pipeline.outputs.contact_sheet:{name}" for name in (
            "SHEET_KEYWORD", "check_sheet_places", "is_sheet", "remove_surplus_sheets", "sheet_path")),
        "pipeline.rendering.mesh_samples:sample_cloud", "pipeline.rendering.ground_truth", "pipeline.rendering.views",
    *_RANDOM_ROTATION,
        "z2p_core.quality.metrics", "z2p_core.meshes.synthetic_noise",
        "z2p_core.meshes.triangle_sampling", *_RENDERER, *_RENDERS, *_NETWORK, *_CONTROLS,
    ),
    "reference": ("pipeline.rendering.ground_truth", "z2p_core.scene", *_RENDERS),
    "textured": (
        "pipeline.rendering.textured_truth",
        *(f"pipeline.rendering.ground_truth:{name}" for name in ("COVERAGE_FILE", "PICTURE_FILE", "scene_stem")),
        "z2p_core.scene", *_TEXTURED_RENDERS, *_RENDERS, *_RANDOM_ROTATION,
    ),
    "measure": (
        "workflows.report.stages:Measure", "pipeline.outputs.point_preview", f"{_PAPER}.measure",
        "z2p_core.quality.metrics", *_CASES,
    ),
    "scans": (
        "workflows.report.stages:Scans", "pipeline.outputs.point_preview", f"{_PAPER}.real_scans", f"{_PAPER}.measure",
        "z2p_core.quality.metrics", "z2p_core.api.point_arrays", "z2p_core.api.point_cloud_objects",
        "z2p_core.api.object_fields", "z2p_core.api.object_columns", "z2p_core.images",
        "z2p_core.rotations", "storage.files.bounded_json", "storage.files.printable_names",
        *modules_in("pipeline.placement"), *modules_in("z2p_core.placement"), *modules_in("z2p_core.up_axis"),
        *modules_in("z2p_core.formats"), *modules_in("z2p_core.formats.arrays"), *modules_in("z2p_core.formats.tables"),
        *modules_in("storage.scans"), *_CASES,
    ),
    "times": ("workflows.report.stages:Times", f"{_PAPER}.timing", *_CASES),
    "trust": (
        "workflows.report.stages:Trust", "pipeline.outputs.point_preview", f"{_PAPER}.uncertainty", f"{_PAPER}.measure",
        "z2p_core.quality.metrics", *_CASES,
    ),
    "report": (
        "workflows.report.stages:Report", f"{_PAPER}.capability_table",
        *(f"{_PAPER}.page.{name}" for name in ("report", "color_fidelity", "results", "captions", "summary", "plots",
                                               "tables")),
        *(f"{_PAPER}.methods:{name}" for name in ("Method", "BASELINE", "TRUTH", "WEIGHTS")),
        f"{_PAPER}.measure:ROWS_FILE", f"{_PAPER}.timing:TIMES_FILE", f"{_PAPER}.uncertainty:UNCERTAINTY_FILE",
        "storage.models.checkpoints",
    ),
    "compare": (
        "workflows.ablation.stages:Compare",
        *(f"pipeline.evaluation.ablation.{name}" for name in ("page", "curves", "outcomes")),
        "storage.models.checkpoints", "z2p_core.config.ablation", "z2p_core.config.pipeline:batch_size",
        "z2p_core.config.pipeline:samples_until", "z2p_core.quality.metrics:METRIC_NAMES",
    ),
}
"""Stage -> the parts that its result depends on, beside plugins, whose own digests are in the fingerprint as well."""

NOT_IN_FINGERPRINT: dict[str, str] = {
    # values that are in the fingerprint themselves
    "z2p_core.config": "re-exports its pipeline module",
    "z2p_core.config.pipeline": "a stage's values are in its fingerprint; functions that compute with them are listed",
    "z2p_core.config.report": "a stage's values are in its fingerprint",
    "z2p_core.registry": "finds plugins, whose code is in the fingerprint",
    "z2p_core.interfaces": "abstract classes, except Control and Slider, which are listed where they matter",
    "workflows.ablation.plan": "its steps' fields are in their fingerprints",
    "workflows.sources": "the values that a source leads to are in the fingerprint",
    # where files lie, not what is in them
    "workflows.stage_task": "finds folders and calls the stage",
    "workflows.report.report_task": "finds folders and calls the stage",
    "workflows.upkeep.reuse_views": "copies renders of equal fields, after a check of their sha256",
    "storage.results.store": "moves files without changing them",
    "storage.results.fingerprints": "names results by sha256, and seeds, which stay the same for the same fields",
    "storage.results.code_digest": "computes the digests in the fingerprint",
    "storage.files.atomic_write": "writes the bytes that it is given",
    "pipeline.child_process": "sets the environment in which Blender's process finds the code",
    "pipeline.evaluation.baselines": "draws the baselines beside the weights; its pictures have their own fingerprints",
    "pipeline.evaluation.time_limit": "stops baselines that take too long, which their rows say, and changes no result",
    "z2p_core.native.source_digest": "finds the kernels and compares them with their sources",
    # only accept or refuse input
    "z2p_core.errors.value_limits": "refuses values, and changes none",
    "z2p_core.network.tensor_shapes": "refuses networks, and builds none",
    "storage.models.card_schema": "refuses cards, and changes none",
    "storage.files.bounded_json": "refuses texts, and parses the others as the json module does",
    "storage.scans.memory_limit": "refuses scans that do not fit into memory",
    # only messages and logs
    "z2p_core.errors.messages": "words of errors",
    "z2p_core.errors.missing_system_libraries": "words of errors",
    "z2p_core.errors.did_you_mean": "words of errors",
    "z2p_core.errors.install_advice": "words of errors",
    "storage.files.disk_errors": "words of errors",
    "storage.files.printable_names": "file names in messages, and whether files exist",
    "shapes/pipeline.render:_failure": "words of an error of Blender",
    "workflows.process.task_log": "writes the log",
    "z2p_core.network.telemetry": "switches off the telemetry of libraries",
    # only for users' clouds
    "z2p_core.placement.placed_camera": "cameras of users; stages draw with the usual one",
    "z2p_core.pinhole": "cameras of users; stages draw with the usual one",
    "z2p_core.placement.viewpoint": "places users' clouds; the pipeline's views are drawn at random",
    "z2p_core.up_axis.axis_names": "parses what users write; the rotations of the axes are listed",
}
"""Module, or ``stage/module:definition``, that a stage's code imports but its fingerprint leaves out -> why.

An entry for a module does not cover definitions of it that some stage lists in `STAGE_CODE`: every other stage that
uses such a definition lists it too, or leaves it out by a ``stage/module:definition`` entry.
Modules of plugins need no entry: they are in the plugins' own digests.
"""

PACKAGES: dict[str, tuple[str, ...]] = {
    "shapes": ("numpy", "bpy"),
    "sample": ("numpy", "trimesh"),
    "render": ("numpy", "trimesh", "bpy"),
    "textured_render": ("numpy", "trimesh", "bpy"),
    "shard": ("numpy", "h5py"),
    "train": ("numpy", "torch", "onnx", "onnxruntime"),
    "evaluate": ("numpy", "trimesh", "bpy", "torch", "kornia", "flip-evaluator"),
    "reference": ("numpy", "trimesh", "bpy"),
    "textured": ("numpy", "trimesh", "bpy"),
    "measure": ("numpy", "trimesh", "bpy", "open3d", "torch", "kornia", "flip-evaluator"),
    "scans": ("numpy", "trimesh", "bpy", "open3d", "torch", "kornia", "flip-evaluator"),
    "times": ("numpy", "trimesh", "bpy", "open3d", "torch", "onnxruntime"),
    "trust": ("numpy", "trimesh", "bpy", "open3d", "torch", "kornia", "flip-evaluator"),
    "report": ("numpy", "torch", "kornia"),
    "compare": ("numpy",),
}
"""Stage -> the distributions whose versions are in its fingerprint."""
_DISTRIBUTIONS = {"open3d": "open3d-cpu"}
"""Package -> another distribution that may provide it."""


def stage_code(stage: str) -> dict[str, str]:
    """Digest (64 hex digits) of each part that `STAGE_CODE` lists for the stage, as of when this process first read it.

    Raises:
        KeyError: an unknown stage.
    """
    return {part: cached_part_digest(part) for part in STAGE_CODE[stage]}


def changed_parts(code: Mapping[str, str]) -> list[str]:
    """Parts of a `stage_code` whose code on the disk differs by now."""
    return [part for part, digest in code.items() if current_part_digest(part) != digest]


def stage_packages(stage: str) -> dict[str, str]:
    """Installed version of each of the stage's `PACKAGES`, without its build: ``2.13.0`` for ``2.13.0+cpu``.

    Raises:
        KeyError: an unknown stage.
    """
    return {package: installed_version(package) for package in PACKAGES[stage]}


@lru_cache(maxsize=64)
def installed_version(package: str) -> str:
    """Version of an installed package, or ``not installed``."""
    for distribution in (package, _DISTRIBUTIONS.get(package, package)):
        with suppress(metadata.PackageNotFoundError):
            return metadata.version(distribution).partition("+")[0]
    return "not installed"
