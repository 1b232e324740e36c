"""The code and the packages that shape each stage's result: their digests and versions are in its fingerprint.

Digests are of syntax trees without docstrings, so comments and layout change nothing. The lists are written by hand and
tested: a module that a stage's code imports must be in `SHAPING` or, with the reason, in `NOT_SHAPING`. A name is a
module's, or ``module:definition`` where only a part of a module shapes the result, or ``folder/file`` for code that no
module imports; of what is not Python or C every byte counts.

A change that gives the same results (a refactoring) can be vouched for with `z2p adopt`, at no cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from importlib import metadata

from z2p_renderer.storage.code import part_digest, present_digest

_CONTROLS = ("z2p_core.interfaces:Control", "z2p_core.interfaces:Slider", "z2p_core.scene")
_MESHES = ("storage.meshes", "z2p_core.ply_header")
_PICTURES = ("pipeline.render", "pipeline.blender", "z2p_core.camera", "z2p_core.geometry", "z2p_core.images", *_MESHES)
_KERNEL_FILES = (
    "axes.h", "cells.c", "centres.c", "clips.c", "clips.h", "colour.c", "compiling.py", "disc.h", "fast.h", "floor.h",
    "gather.c", "gloss.c", "grid.c", "grid.h", "hits.c", "holes.c", "jets.c", "lanes.h", "light.c", "mirror.c",
    "planes.c", "project.c", "refine.c", "refine_network.h", "refine_weights.h", "rows.c", "shade.c", "shadow.c",
    "showing.c", "sight.h", "slabs.c", "splat.c", "touch.c", "wide.c",
)
_KERNELS = (
    "z2p_core.native", *(f"z2p_core.native.{name}" for name in ("calls", "lighting", "pictures", "rows", "surfaces")),
    *(f"z2p_core/native/{name}" for name in _KERNEL_FILES),
)
_NETWORK = (
    "pipeline.buffers", "pipeline.load", "storage.checkpoints", "z2p_core.model", "z2p_core.splatting",
    "z2p_core.camera", "z2p_core.discs", "z2p_core.lamps", "z2p_core.principled", "z2p_core.reflection",
    "z2p_core.scene", "z2p_core.shades", "z2p_core.tangents", "z2p_core.threads", "z2p_core.touch", "z2p_core.turning",
    "z2p_core.window", *_KERNELS,
)

OF_WEIGHTS = (
    "pipeline.buffers", "pipeline.load", "pipeline.infer", "pipeline.enlarging", "pipeline.engines",
    "storage.checkpoints", "storage.exports", "storage.graphs", "storage.shelf", "z2p_core.discs", "z2p_core.model",
    "z2p_core.lamps", "z2p_core.principled", "z2p_core.reflection", "z2p_core.shades", "z2p_core.sizes",
    "z2p_core.splatting", "z2p_core.tangents", "z2p_core.threads", "z2p_core.touch", "z2p_core.turning",
    "z2p_core.window", *_KERNELS,
)
"""Parts that only weights run: what a baseline or the truth gives in a report does not change with them."""
PLACING = (
    "z2p_core.tangents", "z2p_core.threads", "z2p_core.turning",
    *(f"z2p_core.native{part}" for part in ("", ".calls", ".pictures", ".surfaces")),
    *(f"z2p_core/native/{name}" for name in ("axes.h", "fast.h", "grid.c", "grid.h", "jets.c", "planes.c", "showing.c",
                                             "slabs.c")),
)  # fmt: skip
"""Those of them that placing a scan runs as well, whichever method then draws it."""
_CASES = (
    *(f"pipeline.paper.{name}" for name in ("sweeps", "clouds", "made", "references", "methods")), "pipeline.baselines",
    *(f"pipeline.evaluate:{name}" for name in ("draw_views", "in_scene", "UPRIGHT")), "pipeline.infer",
    "pipeline.enlarging", "pipeline.engines", "pipeline.sample:draw_cloud", "pipeline.truth", "pipeline.views",
    "pipeline.shapes",
    "storage.exports", "storage.graphs", "storage.shelf", "z2p_core.sizes",
    "z2p_core.framing:UP_AXES", "z2p_core.noise", "z2p_core.surface", *_PICTURES, *_NETWORK, *_CONTROLS,
)

SHAPING: dict[str, tuple[str, ...]] = {
    "shapes": (
        "workflows.stages:Shapes", "pipeline.shapes", "pipeline.render:export_suzanne", "pipeline.render:_run_blender",
        "pipeline.blender:export_suzanne", "storage.meshes:write_mesh", "storage.meshes:_vertex_block",
    ),
    "sample": (
        "workflows.stages:SampleMesh", "pipeline.sample", "z2p_core.geometry", "z2p_core.noise", "z2p_core.surface",
        *_MESHES,
    ),
    "render": ("workflows.stages:RenderChunk", "pipeline.views", *_PICTURES, *_CONTROLS),
    "shard": (
        "workflows.stages:ShardMesh", "pipeline.shard", "pipeline.views:load_controls", "storage.shards",
        "z2p_core.images", *_CONTROLS,
    ),
    "train": (
        "workflows.stages:Train", "pipeline.train", "pipeline.run", "pipeline.dataset", "pipeline.augment",
        "pipeline.teacher", "pipeline.cropping", "pipeline.curve", "pipeline.engines", "pipeline.export",
        "pipeline.halving", "pipeline.haze",
        "pipeline.shard:shrink_pictures", "storage.exports", "storage.graphs", "storage.shards", "storage.shelf",
        "z2p_core.config:batch_size", "z2p_core.config:samples_until", "z2p_core.flip", "z2p_core.geometry",
        "z2p_core.images", "z2p_core.losses",
        "z2p_core.metrics:PIXELS_A_DEGREE", "z2p_core.noise", "z2p_core.sliding",
        *_NETWORK,
    ),
    "evaluate": (
        "workflows.stages:Evaluate", "pipeline.evaluate", "pipeline.baselines:on_true_floor", "pipeline.infer",
        "pipeline.enlarging", "pipeline.engines", "storage.exports", "storage.graphs", "storage.shelf",
        "pipeline.dots", "pipeline.sample:draw_cloud", "pipeline.sheet_files", "pipeline.sheets", "pipeline.truth",
        "pipeline.views", "z2p_core.framing:UP_AXES",
        "z2p_core.metrics", "z2p_core.noise", "z2p_core.sizes", "z2p_core.surface", *_PICTURES, *_NETWORK, *_CONTROLS,
    ),
    "reference": ("pipeline.truth", "z2p_core.scene", *_PICTURES),
    "measure": (
        "workflows.report_stages:Measure", "pipeline.dots", "pipeline.paper.measure", "z2p_core.metrics", *_CASES,
    ),
    "scans": (
        "workflows.report_stages:Scans", "pipeline.paper.scans", "pipeline.paper.measure", "z2p_core.metrics",
        "pipeline.dots", "pipeline.placing", "pipeline.few_points", "pipeline.stance", "pipeline.viewing",
        "z2p_core.lone_points", "z2p_core.thinning", "z2p_core.up_axis", "z2p_core.upright",
        "z2p_core.upright_weights", "pipeline.hints",
        "storage.clouds", "storage.repeats", "storage.incoming",
        "storage.apart", "storage.finding", "storage.foreign", "storage.quiet", "storage.readers",
        "storage.up_hints", "storage.json_text", "storage.names", "z2p_core.up_comments", "z2p_core.up_names",
        "z2p_core.up_programs",
        "z2p_core.axis_names", "z2p_core.column_names", "z2p_core.dropouts", "z2p_core.framing", "z2p_core.foreground",
        "z2p_core.colmap_model", "z2p_core.float_rows", "z2p_core.geographic", "z2p_core.lidar_rows",
        "z2p_core.number_grids", "z2p_core.other_arrays", "z2p_core.point_maps", "z2p_core.side_columns",
        "z2p_core.depth_maps", "z2p_core.nodata", "z2p_core.quaternions",
        "z2p_core.point_arrays", "z2p_core.point_holders", "z2p_core.pose_rows",
        "z2p_core.smoothing", "z2p_core.spread", "z2p_core.standing", "z2p_core.strays", "z2p_core.viewpoint", *_CASES,
    ),
    "times": ("workflows.report_stages:Times", "pipeline.paper.times", *_CASES),
    "trust": ("workflows.report_stages:Trust", "pipeline.dots", "pipeline.paper.trust", "pipeline.paper.measure",
              "z2p_core.metrics", *_CASES),
    "report": (
        "workflows.report_stages:Report",
        *(f"pipeline.paper.{name}" for name in ("report", "abilities", "fidelity", "findings", "kinds", "lead", "plots",
                                                "tables")),
        *(f"pipeline.paper.methods:{name}" for name in ("Method", "BASELINE", "TRUTH", "WEIGHTS")),
        "pipeline.paper.measure:ROWS", "pipeline.paper.times:TIMES", "pipeline.paper.trust:TRUST",
        "storage.checkpoints",
    ),
    "compare": (
        "workflows.ablation_stages:Compare", *(f"pipeline.ablation.{name}" for name in ("page", "curves", "outcomes")),
        "storage.checkpoints", "z2p_core.ablation_config", "z2p_core.config:batch_size",
        "z2p_core.config:samples_until", "z2p_core.metrics:NAMES",
    ),
}
"""Stage -> what shapes its result, beside the plugins, whose own digests are in the fingerprint as well."""

NOT_SHAPING: dict[str, str] = {
    "z2p_core.config": "the values that a stage gets are in its fingerprint; what reckons with them is listed",
    "z2p_core.one_line": "words errors",
    "z2p_core.network_shapes": "refuses networks, and makes none",
    "z2p_core.limits": "refuses values, and changes none",
    "storage.cards": "refuses cards, and changes none",
    "storage.json_text": "refuses texts, and reads the others as json does",
    "z2p_core.registry": "finds plugins, whose code is in the fingerprint",
    "z2p_core.interfaces": "abstract but for Control and Slider, which are listed where they count",
    "storage.layout": "puts files where they belong, whatever they hold",
    "storage.fingerprints": "names results and seeds by sha256",
    "storage.code": "tells the code that names results",
    "z2p_core.system_libraries": "words of an error",
    "z2p_core.native.sources": "tells where the kernels lie, and what they come from",
    "pipeline.children": "tells where Blender's process finds our code",
    "train/z2p_core.interfaces:Control": "shards hold the settings as encoded; only names and sizes are compared",
    "pipeline.baselines": "stands beside the weights; its pictures have fingerprints of their own",
    "workflows.tasks": "what all tasks share: where files lie, not what is in them",
    "workflows.ablation_plan": "what it plans is in the fingerprints",
    "workflows.task_log": "tells how a task is doing",
    "workflows.known_views": "copies renders whose fields and digests are the very same",
    "z2p_core.report_config": "the values that a stage gets are in its fingerprint",
    "workflows.report_task": "what the report's tasks share: where files lie, not what is in them",
    "plugins.baselines.normals": "in the digests of the plugins that use it",
    "plugins.readers.array_clouds": "in the digests of the readers that use it",
    "plugins.readers.text_content": "in the digest of the reader that uses it",
    "plugins.readers.text_doubts": "in the digest of the reader that uses it",
    "plugins.readers.text_form": "in the digest of the reader that uses it",
    "plugins.readers.text_grid": "in the digest of the reader that uses it",
    "plugins.readers.text_heads": "in the digest of the reader that uses it",
    "plugins.readers.text_writing": "in the digest of the reader that uses it",
    "plugins.readers.ply_lists": "in the digest of the reader that uses it",
    "plugins.readers.gltf": "in the digest of the reader that uses it",
    "plugins.readers.late": "how the readers' libraries are imported shapes nothing",
    "plugins.readers.lengths": "in the digests of the readers that use it",
    "plugins.baselines.apart": "runs another function elsewhere, whose answer is the same",
    "storage.memory": "refuses what does not fit, and changes nothing of what does",
    "storage.room": "tells what a disk refuses",
    "shapes/pipeline.render:_failure": "tells why Blender failed",
    "storage.whole": "writes the bytes that it is given",
    "storage.names": "tells people of files, and whether they are there",
    "z2p_core.guesses": "tells people what they may have meant",
    "z2p_core.install_advice": "tells people how to install what is missing",
    "z2p_core.telemetry": "keeps libraries from telling others of their use",
    "z2p_core.viewpoint": "turns users' clouds; the pipeline's views are drawn",
    "z2p_core.framing": "frames users' clouds; the pipeline's are framed by their mesh",
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
_OTHERWISE = {"open3d": "open3d-cpu"}
"""Package -> the distribution that brings it where its own does not."""


def stage_code(stage: str) -> dict[str, str]:
    """Digest (64 hex digits) of each part that `SHAPING` lists for a stage.

    Raises:
        KeyError: an unknown stage.
    """
    return {part: part_digest(part) for part in SHAPING[stage]}


def changed_parts(code: Mapping[str, str]) -> list[str]:
    """Those parts of a `stage_code` that read otherwise on the disk by now."""
    return [part for part, digest in code.items() if present_digest(part) != digest]


def stage_packages(stage: str) -> dict[str, str]:
    """Installed version of each of the stage's `PACKAGES`, without its build: ``2.13.0`` for ``2.13.0+cpu``.

    Raises:
        KeyError: an unknown stage.
    """
    return {package: installed_version(package) for package in PACKAGES[stage]}


@lru_cache(maxsize=64)
def installed_version(package: str) -> str:
    """Version of an installed package, or ``not installed``."""
    for distribution in (package, _OTHERWISE.get(package, package)):
        with suppress(metadata.PackageNotFoundError):
            return metadata.version(distribution).partition("+")[0]
    return "not installed"
