"""Time and peak memory from a file to a PNG, by format: ``python benchmarks/file_formats.py [POINTS] [REPEATS]``.

Writes one colored cloud with intensities in every format, and draws each file in a process of its own. Prints a table:
wall and processor time, their ratio to npy's in the same run, and the peak memory of the process and its children.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
from pypcd4 import Encoding, PointCloud

STEP_METRES = 1e-4
"""Step of the coordinates in LAS files."""
SAMPLE_SECONDS = 0.02
"""Time between two measurements of memory."""


def main(count: int, repeats: int) -> None:
    """Prints a line for each format."""
    with tempfile.TemporaryDirectory(prefix="z2p-formats-") as place:
        runs = {path.name: [_measure(path) for _ in range(repeats)] for path in _write_all(Path(place), count)}
    rows = {name: tuple(map(statistics.median, zip(*values, strict=True))) for name, values in runs.items()}
    base = rows["a.npy"]
    print("| file | wall, s | to npy | processor, s | to npy | peak, MB |\n|---|--:|--:|--:|--:|--:|")
    for name, (wall, processor, peak) in rows.items():
        print(f"| {name} | {wall:.2f} | {wall / base[0]:.2f} | {processor:.2f} | {processor / base[1]:.2f} "
              f"| {peak / 1e6:.0f} |")  # fmt: skip


def _write_all(folder: Path, count: int) -> Iterator[Path]:
    """Writes the cloud in each format, one at a time, and yields its path."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(count, 3)).astype(np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    rgb = (127 * (points + 1)).astype(np.uint8)
    intensity = rng.integers(0, 1000, count).astype(np.uint16)
    np.save(folder / "a.npy", points)
    yield folder / "a.npy"
    yield _write_ply(folder / "a.ply", points, rgb, intensity)
    for name in ("a.las", "a.laz"):
        yield _write_las(folder / name, points, rgb, intensity)
    packed = (rgb.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)).view(np.float32)
    columns = [*points.T, packed, intensity.astype(np.float32)]
    cloud = PointCloud.from_points(columns, ("x", "y", "z", "rgb", "intensity"), (np.float32,) * 5)
    for name, encoding in (("a.pcd", Encoding.BINARY), ("packed.pcd", Encoding.BINARY_COMPRESSED)):
        cloud.save(str(folder / name), encoding=encoding)
        yield folder / name
    yield _write_e57(folder / "a.e57", points, rgb, intensity)


def _write_ply(path: Path, points: np.ndarray, rgb: np.ndarray, intensity: np.ndarray) -> Path:
    kinds = {**dict.fromkeys("xyz", "float"), **dict.fromkeys(("red", "green", "blue"), "uchar"), "intensity": "ushort"}
    types = {"float": "<f4", "uchar": "u1", "ushort": "<u2"}
    rows = np.empty(len(points), [(name, types[kind]) for name, kind in kinds.items()])
    for name, column in zip(kinds, [*points.T, *rgb.T, intensity], strict=True):
        rows[name] = column
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}",
             *(f"property {kind} {name}" for name, kind in kinds.items()), "end_header", ""]  # fmt: skip
    path.write_bytes("\n".join(lines).encode() + rows.tobytes())
    return path


def _write_las(path: Path, points: np.ndarray, rgb: np.ndarray, intensity: np.ndarray) -> Path:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = [STEP_METRES] * 3
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T.astype(np.float64)
    cloud.red, cloud.green, cloud.blue = rgb.T.astype(np.uint16) * 257
    cloud.intensity = intensity
    cloud.write(str(path))
    return path


def _write_e57(path: Path, points: np.ndarray, rgb: np.ndarray, intensity: np.ndarray) -> Path:
    import pye57

    columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), points.T.astype(np.float64).copy(), strict=True))
    columns |= dict(zip(("colorRed", "colorGreen", "colorBlue"), rgb.T.copy(), strict=True))
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw({**columns, "intensity": intensity.astype(np.float64)})
    file.close()
    return path


def _measure(path: Path) -> tuple[float, float, float]:
    """Seconds of wall and processor, and the peak memory in bytes, of drawing a file in a process of its own."""
    command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "render", str(path), "--output",
               str(path.with_suffix(".png")), "--overwrite"]  # fmt: skip
    before, begun, peak = _child_seconds(), time.perf_counter(), 0
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while process.poll() is None:
        peak = max(peak, sum(map(_memory, _with_children(process.pid))))
        time.sleep(SAMPLE_SECONDS)
    if process.returncode:
        raise SystemExit(f"{path.name}: z2p ended with status {process.returncode}")
    return time.perf_counter() - begun, _child_seconds() - before, peak


def _child_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _with_children(process: int) -> list[int]:
    """The process and all that it has started (Linux)."""
    found = [process]
    try:
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in (task / "children").read_text().split():
                found += _with_children(int(child))
    except OSError:  # it has ended
        pass
    return found


def _memory(process: int) -> int:
    """Memory of a process in bytes, of shared pages its share (Linux)."""
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000, int(sys.argv[2]) if len(sys.argv) > 2 else 3)
