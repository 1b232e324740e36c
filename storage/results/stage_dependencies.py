"""The code and the packages that shape each stage's result: their digests and versions are in its fingerprint.

Digests are of syntax trees without docstrings, so comments and layout change nothing. The lists are written by hand and
tested: a module that a stage's code imports must be in `STAGE_CODE` or, with the reason, in `NOT_IN_FINGERPRINT`. A name
is a module's, or ``module:definition`` where only a part of a module shapes the result, or ``folder/file`` for code
that no module imports; of what is not Python or C every byte counts.

A change that gives the same results (a refactoring) can be vouched for with `z2p adopt`, at no cost.
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
"""Packages of which a stage lists all modules where it needs one: they change together, and are named in one word."""


def modules_in(package: str) -> tuple[str, ...]:
    """The modules of one of the `WHOLE_PACKAGES`, its own name first; not those of packages below it."""
    assert package in WHOLE_PACKAGES
    folder = module_file(package).parent
    return (package, *(f"{package}.{path.stem}" for path in sorted(folder.glob("[!_]*.py"))
                       if f"{package}.{path.stem}" not in BUILD_MODULES))  # fmt: skip


def c_files_below(folder: str) -> tuple[str, ...]:
    """All C files in the folders of a ``folder/folder``, as parts."""
    root = CORE_FOLDER.parent
    return tuple(path.relative_to(root).as_posix() for path in sorted((root / folder).glob("*/*.[ch]")))


BUILD_MODULES = ("z2p_core.native.build", "z2p_core.native.source_digest", "z2p_core.native.wheels")
"""Modules that no stage imports: they compile the kernels, which the compiler's flags shape, and name wheels."""
_CONTROLS = ("z2p_core.interfaces:Control", "z2p_core.interfaces:Slider", "z2p_core.settings", "z2p_core.scene")
_MESHES = ("storage.meshes", "z2p_core.formats.ply_header")
_RENDERS = (
    "pipeline.render", "pipeline.blender", "z2p_core.camera", "z2p_core.placement.bounding_sphere", "z2p_core.images",
    *_MESHES,
)
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
"""Parts that only weights run: what a baseline or the truth gives in a report does not change with them."""
PLACEMENT_CODE = (
    "z2p_core.parallel", "z2p_core.linalg", *modules_in("z2p_core.surface"), "z2p_core.native",
    *(f"z2p_core.native.{name}" for name in ("library", "images", "points")),
    *(part for part in _KERNELS if part.startswith(("z2p_core/native/c/points/", "z2p_core/native/c/common/"))),
)
"""Those of them that placing a scan runs as well, whichever method then draws it."""
_CASES = (
    *(f"pipeline.evaluation.paper.cases.{name}" for name in ("sweeps", "synthetic_scans", "synthetic_shapes",
                                                              "ground_truth")),
    "pipeline.evaluation.paper.methods", "pipeline.evaluation.baselines",
    *(f"pipeline.evaluation.evaluate:{name}" for name in ("sample_views", "UPRIGHT_SHARE")),
    "pipeline.rendering.mesh_samples:sample_cloud", "pipeline.rendering.ground_truth", "pipeline.rendering.views",
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
    "render": ("workflows.stages:RenderChunk", "pipeline.rendering.views", *_RENDERS, *_CONTROLS),
    "shard": (
        "workflows.stages:ShardMesh", "pipeline.training.make_shard", "pipeline.rendering.views:load_controls",
        "storage.shards", "z2p_core.images", *_CONTROLS,
    ),
    "train": (
        "workflows.stages:Train",
        *(f"pipeline.training.{name}" for name in ("train", "state", "dataset", "augment", "distillation", "cropping",
                                                   "learning_curve", "shadow_debias")),
        "pipeline.training.make_shard:downsample_images", "pipeline.export", "pipeline.export.fp16_constants",
        "pipeline.inference.engine_selection", *_EXPORTED_FILES, "storage.shards",
        "z2p_core.config.pipeline:batch_size", "z2p_core.config.pipeline:samples_until", "z2p_core.images",
        "z2p_core.placement.bounding_sphere",
        *(f"z2p_core.quality.{name}" for name in ("flip_loss", "losses", "metrics:PIXELS_PER_DEGREE",
                                                  "metrics:SSIM_WINDOW", "metrics:FOREGROUND_COVERAGE",
                                                  "separable_filter", "validation_metrics")),
        "z2p_core.meshes.synthetic_noise", *_NETWORK,
    ),
    "evaluate": (
        "workflows.stages:Evaluate", "pipeline.evaluation.evaluate", "pipeline.evaluation.baselines:with_true_floor",
        "pipeline.evaluation.comparison_sheet", "pipeline.outputs.point_preview",
        *(f"pipeline.outputs.contact_sheet:{name}" for name in (
            "SHEET_KEYWORD", "check_sheet_places", "is_sheet", "remove_surplus_sheets", "sheet_path")),
        "pipeline.rendering.mesh_samples:sample_cloud", "pipeline.rendering.ground_truth", "pipeline.rendering.views",
        "z2p_core.quality.metrics", "z2p_core.meshes.synthetic_noise",
        "z2p_core.meshes.triangle_sampling", *_RENDERER, *_RENDERS, *_NETWORK, *_CONTROLS,
    ),
    "reference": ("pipeline.rendering.ground_truth", "z2p_core.scene", *_RENDERS),
    "measure": (
        "workflows.report.stages:Measure", "pipeline.outputs.point_preview", f"{_PAPER}.measure",
        "z2p_core.quality.metrics", *_CASES,
    ),
    "scans": (
        "workflows.report.stages:Scans", "pipeline.outputs.point_preview", f"{_PAPER}.real_scans", f"{_PAPER}.measure",
        "z2p_core.quality.metrics", "z2p_core.api.point_arrays", "z2p_core.api.point_cloud_objects",
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
"""Stage -> what shapes its result, beside the plugins, whose own digests are in the fingerprint as well."""

NOT_IN_FINGERPRINT: dict[str, str] = {
    "z2p_core.config": "hands on the names of its pipeline module",
    "z2p_core.config.pipeline": "the values that a stage gets are in its fingerprint; what reckons with them is listed",
    "z2p_core.errors.messages": "words errors",
    "z2p_core.network.tensor_shapes": "refuses networks, and makes none",
    "z2p_core.errors.value_limits": "refuses values, and changes none",
    "storage.models.card_schema": "refuses cards, and changes none",
    "storage.files.bounded_json": "refuses texts, and reads the others as json does",
    "z2p_core.registry": "finds plugins, whose code is in the fingerprint",
    "z2p_core.interfaces": "abstract but for Control and Slider, which are listed where they count",
    "storage.results.store": "puts files where they belong, whatever they hold",
    "storage.results.fingerprints": "names results and seeds by sha256",
    "storage.results.code_digest": "tells the code that names results",
    "z2p_core.errors.missing_system_libraries": "words of an error",
    "z2p_core.native.source_digest": "tells where the kernels lie, and what they come from",
    "pipeline.child_process": "tells where Blender's process finds our code",
    "train/z2p_core.interfaces:Control": "shards hold the settings as encoded; only names and sizes are compared",
    "pipeline.evaluation.baselines": "stands beside the weights; its pictures have fingerprints of their own",
    "workflows.stage_task": "what all tasks share: where files lie, not what is in them",
    "workflows.ablation.plan": "what it plans is in the fingerprints",
    "workflows.process.task_log": "tells how a task is doing",
    "workflows.upkeep.reuse_views": "copies renders whose fields and digests are the very same",
    "z2p_core.config.report": "the values that a stage gets are in its fingerprint",
    "workflows.report.report_task": "what the report's tasks share: where files lie, not what is in them",
    "plugins.baselines._normals": "in the digests of the plugins that use it",
    "plugins.readers._helpers.array_clouds": "in the digests of the readers that use it",
    "plugins.readers._text.line_blocks": "in the digest of the reader that uses it",
    "plugins.readers._text.column_doubts": "in the digest of the reader that uses it",
    "plugins.readers._text.row_format": "in the digest of the reader that uses it",
    "plugins.readers._text.esri_grid": "in the digest of the reader that uses it",
    "plugins.readers._text.header": "in the digest of the reader that uses it",
    "plugins.readers._text.unsupported_notations": "in the digest of the reader that uses it",
    "plugins.readers._helpers.ply_lists": "in the digest of the reader that uses it",
    "plugins.readers._helpers.gltf": "in the digest of the reader that uses it",
    "plugins.readers._helpers.lazy_import": "how the readers' libraries are imported shapes nothing",
    "plugins.readers._helpers.length_check": "in the digests of the readers that use it",
    "plugins.baselines._subprocess": "runs another function elsewhere, whose answer is the same",
    "storage.scans.memory_limit": "refuses what does not fit, and changes nothing of what does",
    "storage.files.disk_errors": "tells what a disk refuses",
    "shapes/pipeline.render:_failure": "tells why Blender failed",
    "storage.files.atomic_write": "writes the bytes that it is given",
    "storage.files.printable_names": "tells people of files, and whether they are there",
    "z2p_core.errors.did_you_mean": "tells people what they may have meant",
    "z2p_core.errors.install_advice": "tells people how to install what is missing",
    "z2p_core.network.telemetry": "keeps libraries from telling others of their use",
    "z2p_core.placement.viewpoint": "turns users' clouds; the pipeline's views are drawn",
    "z2p_core.up_axis.axis_names": "reads what users write; the rotations of its axes are listed",
}
"""Module, or ``stage/module:definition`` -> why it is of no weight although shaping code imports it.

A definition that is listed for one stage is not excused with its module: each stage lists or excuses it by name.
"""

PACKAGES: dict[str, tuple[str, ...]] = {
    "shapes": ("numpy", "bpy"),
    "sample": ("numpy", "trimesh"),
    "render": ("numpy", "trimesh", "bpy"),
    "shard": ("numpy", "h5py"),
    "train": ("numpy", "torch", "onnx", "onnxruntime"),
    "evaluate": ("numpy", "trimesh", "bpy", "torch", "kornia", "flip-evaluator"),
    "reference": ("numpy", "trimesh", "bpy"),
    "measure": ("numpy", "trimesh", "bpy", "open3d", "torch", "kornia", "flip-evaluator"),
    "scans": ("numpy", "trimesh", "bpy", "open3d", "torch", "kornia", "flip-evaluator"),
    "times": ("numpy", "trimesh", "bpy", "open3d", "torch", "onnxruntime"),
    "trust": ("numpy", "trimesh", "bpy", "open3d", "torch", "kornia", "flip-evaluator"),
    "report": ("numpy", "torch", "kornia"),
    "compare": ("numpy",),
}
"""Stage -> the declared packages whose versions shape its result."""
_DISTRIBUTIONS = {"open3d": "open3d-cpu"}
"""Package -> the distribution that brings it where its own does not."""


def stage_code(stage: str) -> dict[str, str]:
    """Digest (64 hex digits) of each part that `STAGE_CODE` lists for a stage.

    Raises:
        KeyError: an unknown stage.
    """
    return {part: cached_part_digest(part) for part in STAGE_CODE[stage]}


def changed_parts(code: Mapping[str, str]) -> list[str]:
    """Those parts of a `stage_code` that read otherwise on the disk by now."""
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
