"""Cycles renders of a mesh: one Blender child process a call, resumable picture by picture.

bpy is GPL and may crash on a bad mesh, so `pipeline.blender` runs it in a separate process.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from z2p_core.config.pipeline import DENOISE_QUALITIES, RENDER_PASSES
from z2p_core.images import bytes_from_unit, srgb_from_linear, straight_from_premultiplied, unit_from_bytes
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.child_process import child_environment
from z2p_renderer.storage.files.atomic_write import atomic_path, atomic_write
from z2p_renderer.storage.files.disk_errors import DiskError, disk_error_message, full_disk_message
from z2p_renderer.storage.meshes import Mesh, read_mesh

MAX_DEPTH = 1000.0
"""Depth beyond which a pixel's first sample hit nothing, world units."""

Scenes = Sequence[tuple[str, SceneDescription]]


class RenderError(RuntimeError):
    """Blender failed; the message names the mesh and the picture, and ends with Blender's last lines."""


@dataclass(frozen=True)
class RenderSettings:
    """Cycles settings; all but `threads` affect the pixels."""

    resolution: tuple[int, int] = (512, 512)
    """Width and height in pixels."""
    samples: int = 4
    denoise: str = "fast"
    bounces: int = 3
    passes: tuple[str, ...] = ()
    seed: int = 0
    threads: int = 0
    """0 for all cores."""

    def __post_init__(self) -> None:
        if self.denoise not in DENOISE_QUALITIES:
            raise ValueError(f"denoise: expected one of {', '.join(DENOISE_QUALITIES)}, got {self.denoise!r}")
        for name in self.passes:
            if name not in RENDER_PASSES:
                raise ValueError(f"passes: expected some of {', '.join(RENDER_PASSES)}, got {name!r}")

    def shaping(self) -> dict[str, Any]:
        """All settings that affect the pixels, by name, for fingerprints."""
        return {name: value for name, value in asdict(self).items() if name != "threads"}


def render_scenes(
    mesh_path: Path,
    scenes: Scenes,
    out: Path,
    settings: RenderSettings,
    log: Callable[[str], None] = lambda line: None,
) -> None:
    """Render each (stem, scene) of a mesh file into `out`, as `render_mesh` does.

    The mesh is centred on its bounding sphere and scaled to radius 1.

    Raises:
        ScanError: the mesh cannot be read.
        RenderError: Blender failed or left out a picture.
        DiskError: the disk is full, here or in Blender.
    """
    if all((out / f"{stem}.png").exists() for stem, _ in scenes):
        return  # without reading the mesh
    mesh = read_mesh(mesh_path)
    placed = Mesh(bounding_sphere(mesh.vertices).normalise(mesh.vertices), mesh.faces, mesh.smooth)
    render_mesh(placed, scenes, out, settings, log, mesh_path.name)


def render_mesh(
    mesh: Mesh,
    scenes: Scenes,
    out: Path,
    settings: RenderSettings,
    log: Callable[[str], None] = lambda line: None,
    name: str = "mesh",
) -> None:
    """Render each (stem, scene) of a mesh in world units into `out`; pictures that are there already are left alone.

    Writes ``STEM.png`` (RGBA, straight sRGB, soft shadow in the alpha), ``STEM.coverage.png`` (8-bit: how much of the
    pixel the object covers, shadow apart) and, when asked for, ``STEM.passes.npz`` (float16 ``depth`` in world units
    and ``normal`` (H, W, 3) in world axes, both 0 off the object; ``shadow`` (H, W, 3), the light that is left on the
    floor). The floor touches the mesh's lowest point, or lies where the scene says. `name` is for messages alone.

    Raises:
        RenderError: Blender failed or left out a picture.
        DiskError: the disk is full, here or in Blender.
    """
    out.mkdir(parents=True, exist_ok=True)
    missing = [(stem, scene) for stem, scene in scenes if not (out / f"{stem}.png").exists()]
    if not missing:
        return
    with tempfile.TemporaryDirectory(prefix=".blender-", dir=out) as folder:
        job = Path(folder)
        vertices = mesh.vertices.astype(np.float32)
        atomic_write(_npz_bytes(vertices=vertices, faces=mesh.faces, smooth=mesh.smooth), job / "mesh.npz")
        described = [(stem, scene.to_json()) for stem, scene in missing]
        (job / "job.json").write_text(json.dumps({"settings": asdict(settings), "scenes": described}))
        started = time.perf_counter()
        for done, stem in enumerate(_run_blender(job, name), start=1):
            try:
                _write_outputs(job / f"{stem}.exr", out, stem)
            except (RuntimeError, LookupError, ValueError) as error:  # what OpenEXR raises on an incomplete file
                raise _failure(job, f"{name}: Blender left no complete picture of {stem} ({error})") from error
            rate = done / (time.perf_counter() - started) * 60
            log(f"{Path(name).stem}: {stem} rendered, {done} of {len(missing)}, {rate:.1f} images a minute")
    left = [stem for stem, _ in missing if not (out / f"{stem}.png").exists()]
    if left:
        raise _failure(out, f"{name}: Blender ended without rendering {left[0]} and {len(left) - 1} more")


def read_render(path: Path, shape: tuple[int, ...]) -> np.ndarray:
    """A stored render as float32 in [0, 1] of the given shape.

    Raises:
        RenderError: it is missing, damaged, or of another shape.
    """
    try:
        with Image.open(path) as image:
            pixels = np.asarray(image)
    except (OSError, SyntaxError) as error:  # pillow raises SyntaxError on a broken chunk
        raise RenderError(f"{path}: not a readable picture ({error}); delete {path.parent} to render again") from error
    if pixels.shape != shape or pixels.dtype != np.uint8:
        raise RenderError(f"{path}: expected {shape} uint8, got {pixels.shape} {pixels.dtype}; "
                          f"delete {path.parent} to render again")
    return unit_from_bytes(pixels)


def export_suzanne(path: Path) -> None:
    """Write Blender's monkey Suzanne as vertices and triangles (``.npz``: ``vertices``, ``faces``)."""
    with tempfile.TemporaryDirectory(prefix="suzanne-") as folder:
        (Path(folder) / "job.json").write_text(json.dumps({"suzanne": str(path.absolute())}))
        for _ in _run_blender(Path(folder), "suzanne"):
            pass
    if not path.exists():
        raise RenderError(f"Blender ended without writing {path}")


def _run_blender(job: Path, name: str) -> Iterator[str]:
    """Yield the stem of each picture as soon as it is whole."""
    command = [sys.executable, "-m", "z2p_renderer.pipeline.blender", str(job)]
    last: deque[str] = deque(maxlen=12)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=child_environment()
    ) as blender:
        try:
            for line in blender.stdout or ():
                last.append(line.rstrip())
                if line.startswith("done "):
                    yield line.split()[1]
        except BaseException:
            blender.kill()
            raise
    if blender.returncode:
        raise _failure(job, f"{name}: Blender exited with {blender.returncode}\nits last lines:\n" + "\n".join(last))


def _failure(folder: Path, message: str) -> RenderError | DiskError:
    """The error for a failure of Blender, which writes into `folder`; a full disk makes it fail in many ways."""
    refused = disk_error_message(message, folder) or full_disk_message(folder)
    return DiskError(refused) if refused else RenderError(message)


def _write_outputs(exr: Path, out: Path, stem: str) -> None:
    """Converts scene-linear passes to the files of `out`; the picture is written last and marks the view complete."""
    import OpenEXR  # late: the pipeline extra

    channels = {}
    for part in OpenEXR.File(str(exr)).parts:
        channels.update({name.split(".", 1)[1]: channel.pixels for name, channel in part.channels.items()})
    exr.unlink()
    coverage = np.clip(channels["coverage.X"], 0, 1)
    _save_png(bytes_from_unit(coverage), out / f"{stem}.coverage.png")
    passes = _extra_passes(channels, coverage)
    if passes:
        atomic_write(_npz_bytes(np.savez_compressed, **passes), out / f"{stem}.passes.npz", durable=True)
    straight = straight_from_premultiplied(np.clip(channels["Combined"], 0, None))
    straight[..., :3] = srgb_from_linear(straight[..., :3])
    _save_png(bytes_from_unit(straight), out / f"{stem}.png")


def _npz_bytes(pack: Callable[..., None] = np.savez, **arrays: Any) -> bytes:
    """Arrays as the bytes of an npz file, to be written at once: np.savez on a full disk raises a second error."""
    content = io.BytesIO()
    pack(content, **arrays)
    return content.getvalue()


def _extra_passes(channels: dict[str, np.ndarray], coverage: np.ndarray) -> dict[str, np.ndarray]:
    on_object = coverage > 0
    passes = {}
    if "Depth.Z" in channels:
        depth = channels["Depth.Z"]
        passes["depth"] = np.where(on_object & (depth < MAX_DEPTH), depth, 0).astype(np.float16)
    if "Normal.X" in channels:
        normal = np.stack([channels[f"Normal.{axis}"] for axis in "XYZ"], -1)
        passes["normal"] = np.where(on_object[..., None], normal, 0).astype(np.float16)
    if "Shadow Catcher" in channels:
        passes["shadow"] = channels["Shadow Catcher"].astype(np.float16)
    return passes


def _save_png(image: np.ndarray, path: Path) -> None:
    with atomic_path(path, durable=True) as temporary:
        Image.fromarray(image).save(temporary, format="PNG", compress_level=3)
