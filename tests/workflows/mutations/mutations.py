"""The mutation matrix: what is changed, and by hand which steps must then run.

`test_mutations.py` tries it on the local scheduler, `test_mutations_luigid.py` on luigid with two worker processes.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from small_store import listing
from world import PYRAMID, WEDGE, World, write_off

SAMPLES = {"sample/tetra", "sample/pyramid"}
RENDERS = {"render/tetra/0-2", "render/pyramid/0-2"}
SHARDS = {"shard/tetra", "shard/pyramid"}
TRAIN, EVALUATE = {"train"}, {"evaluate"}
AFTER = TRAIN | EVALUATE
ALL = SAMPLES | RENDERS | SHARDS | AFTER

Change = Callable[[World], object]


def replaced(path: str, old: str, new: str) -> Change:
    def change(world: World) -> None:
        text = (world.root / path).read_text()
        assert old in text, f"{path} no longer holds {old!r}"
        (world.root / path).write_text(text.replace(old, new, 1))

    return change


def setting(old: str, new: str) -> Change:
    return replaced("small.toml", old, new)


def appended(path: str, text: str) -> Change:
    return lambda world: (world.root / path).write_text((world.root / path).read_text() + text)


def mesh(path: str, shape: tuple[list, list], scale: float = 1.0) -> Change:
    vertices = [tuple(scale * value for value in vertex) for vertex in shape[0]]
    return lambda world: write_off(world.root / path, vertices, shape[1])


def package(name: str, version: str) -> Change:
    def change(world: World) -> None:
        folder = world.code / f"{name}-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")

    return change


def renamed(old: str, new: str) -> Change:
    return lambda world: (world.root / old).rename(world.root / new)


INPUTS: dict[str, tuple[Change, set[str]]] = {
    "points in a pool": (setting("points = 200\n[render]", "points = 300\n[render]"), SAMPLES | SHARDS | AFTER),
    "samples a pixel": (setting("samples = 1\nbounces", "samples = 2\nbounces"), RENDERS | SHARDS | AFTER),
    "chunks": (setting("chunk = 2", "chunk = 1"), {f"render/{m}/{c}" for m in ("tetra", "pyramid")
                                                  for c in ("0-1", "1-2")}),
    "more views": (setting("views = 2", "views = 3"), {"render/tetra/2-3", "render/pyramid/2-3"} | SHARDS | AFTER),
    "steps": (setting("steps = 4", "steps = 5"), AFTER),
    "an encoder": (setting("mapping = 8", 'mapping = 8\nencoder = "fourier"'), AFTER),
    "checkpoints": (setting("checkpoint_every = 2", "checkpoint_every = 1"), set()),
    "evaluation clouds": (setting("points = 100\nres", "points = 150\nres"), EVALUATE),
    "the config's name": (setting('name = "small"', 'name = "other"'), set()),
    "one mesh's bytes": (mesh("meshes/pyramid.off", PYRAMID, 1.5), {"sample/pyramid", "render/pyramid/0-2",
                                                                  "shard/pyramid"} | AFTER),
    "touching a mesh": (lambda world: (world.root / "meshes/tetra.off").touch(), set()),
    "renaming a mesh": (renamed("meshes/tetra.off", "meshes/atom.off"), set()),
    "moving the meshes": (renamed("meshes", "meshes elsewhere"), set()),
    "adding a mesh": (mesh("meshes/added.off", PYRAMID, 0.5),
                      {"sample/added", "render/added/0-2", "shard/added"} | AFTER),
    "removing a mesh": (lambda world: (world.root / "meshes/pyramid.off").unlink(), AFTER),
    "a mesh kept aside": (mesh("kept/wedge.off", WEDGE, 2.0), EVALUATE),
    "a control's version": (replaced("code/plugins/controls/elevation.py", 'version = "1"', 'version = "2"'),
                            RENDERS | SHARDS | AFTER),
    "a control's code": (replaced("code/plugins/controls/elevation.py", "version = ", "extra = 1\n    version = "),
                         RENDERS | SHARDS | AFTER),
    "a z-buffer's code": (appended("code/plugins/zbuffers/splats.py", "\nEXTRA = 1\n"), AFTER),
    "a sampler's code": (appended("code/plugins/samplers/uniform.py", "\nEXTRA = 1\n"), SAMPLES | SHARDS | AFTER),
    "another sampler's code": (appended("code/plugins/samplers/grid.py", "\nEXTRA = 1\n"), set()),
    "comments and docstrings": (lambda world: [
        (world.code / path).write_text("# a comment\n" + (world.code / path).read_text().replace('"""', '"""Well: ', 1))
        for path in ("pipeline/render.py", "pipeline/training/train.py", "plugins/controls/light.py",
                     "storage/meshes.py")
    ], set()),
    "unrelated modules": (lambda world: [appended(f"code/{path}", "\nEXTRA = 1\n")(world) for path in
                          ("pipeline/batch/render_files.py", "pipeline/cli/__init__.py", "workflows/status.py",
                           "storage/results/store.py")], set()),
    "the Blender scene": (appended("code/pipeline/blender.py", "\nEXTRA = 1\n"), RENDERS | SHARDS | AFTER),
    "the sharding code": (appended("code/pipeline/training/make_shard.py", "\nEXTRA = 1\n"), SHARDS | AFTER),
    "the training code": (appended("code/pipeline/training/train.py", "\nEXTRA = 1\n"), AFTER),
    "a metric's code": (appended("code/z2p_core/quality/metrics.py", "\nEXTRA = 1\n"), EVALUATE),
    "torch's version": (package("torch", "99.0"), AFTER),
    "h5py's version": (package("h5py", "99.0"), SHARDS | AFTER),
    "luigi's version": (package("pillow", "99.0"), set()),
    "moving the workspace": (lambda world: (world.workspace.rename(world.root / "moved"),
                                            setattr(world, "workspace", world.root / "moved")), set()),
}  # fmt: skip
"""What a user changes -> the steps that must run, no more and no fewer; undone afterwards."""


def deleted(step: str) -> Change:
    return lambda world: shutil.rmtree(world.manifest(step).parent)


def truncated(step: str, file: str) -> Change:
    return lambda world: os.truncate(world.manifest(step).parent / file, 10)


def flipped(step: str, file: str) -> Change:
    def change(world: World) -> None:
        path = world.manifest(step).parent / file
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)

    return change


def edited_manifest(world: World) -> None:
    path = world.manifest("sample/tetra")
    manifest = json.loads(path.read_text())
    manifest["fields"]["parameters"]["points"] = 7
    path.write_text(json.dumps(manifest))


OUTPUTS: dict[str, tuple[Change, set[str]]] = {
    **{f"deleting {step}": (deleted(step), {step}) for step in
       ("sample/tetra", "render/tetra/0-2", "shard/pyramid", "train", "evaluate")},
    "a truncated pool": (truncated("sample/pyramid", "pool.npy"), {"sample/pyramid"}),
    "a flipped bit in a picture": (flipped("render/tetra/0-2", "view_00001.png"), {"render/tetra/0-2"}),
    "a flipped bit in a shard": (flipped("shard/tetra", "shard.h5"), {"shard/tetra"}),
    "a flipped bit in the weights": (flipped("train", "weights.safetensors"), {"train"}),
    "a manifest that is gone": (lambda world: world.manifest("shard/tetra").unlink(), {"shard/tetra"}),
    "a manifest that lies": (edited_manifest, {"sample/tetra"}),
    "touching every output": (lambda world: [path.touch() for path in world.workspace.glob("[!.]*/*/*")], set()),
}  # fmt: skip
"""What happens to an output -> the steps that must run; the same bytes are there afterwards."""


def check(world: World, expected: set[str]) -> None:
    """The prediction and what runs are as expected; after that nothing is left to run."""
    before = listing(world.workspace)
    assert world.predicted() == expected
    assert listing(world.workspace) == before, "looking wrote something"
    assert world.make() == sorted(expected)  # each once
    assert world.predicted() == set()


def change_and_go_back(world: World, name: str, spare: Path) -> None:
    """Try a row of `INPUTS`; `spare` is an empty folder."""
    change, expected = INPUTS[name]
    kept = {path: spare / path for path in ("code", "meshes", "kept", "small.toml")}
    for path, copy in kept.items():
        source = world.root / path
        shutil.copytree(source, copy) if source.is_dir() else shutil.copy2(source, copy)
    workspace = world.workspace
    try:
        change(world)
        check(world, expected)
    finally:
        for path in world.root.glob("meshes*"):
            shutil.rmtree(path)
        for path, copy in kept.items():
            target = world.root / path
            if copy.is_dir():
                shutil.rmtree(target, ignore_errors=True)
                shutil.copytree(copy, target)
            else:
                shutil.copy2(copy, target)
        if world.workspace != workspace:
            world.workspace.rename(workspace)
            world.workspace = workspace
    assert world.make() == []


def lose_and_mend(world: World, name: str) -> None:
    """Try a row of `OUTPUTS`."""
    change, expected = OUTPUTS[name]
    before = world.digests()
    change(world)
    check(world, expected)
    assert world.digests() == before
