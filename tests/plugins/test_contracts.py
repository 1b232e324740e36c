"""Every registered plugin, built-in or a stranger's, keeps the contract of its interface."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import laspy
import numpy as np
import pytest
import trimesh
from numpy.random import default_rng
from vtk_files import legacy

from z2p_core import registry
from z2p_core.interfaces import Reader, TrainedNetwork
from z2p_core.testing import (
    check_baseline,
    check_condition,
    check_control,
    check_encoder,
    check_engine,
    check_gbuffer,
    check_painter,
    check_reader,
    check_sampler,
    check_texture,
    check_zbuffer,
)
from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.export.graph_rewrite import quantize_int8
from z2p_renderer.pipeline.inference.loading import load_plugins

CLOUD = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.25, 2.0, -1.0], [-3.0, 0.125, 4.0], [0.5, 0.75, 1.5]])
LYING_PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n"
)
LYING_PCD = (
    b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1000000000\nHEIGHT 1\n"
    b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1000000000\nDATA binary\n"
)


def write_lines(path: Path, header: str = "", prefix: str = "") -> None:
    rows = "".join(f"{prefix}{x} {y} {z}\n" for x, y, z in CLOUD)
    path.write_text(header + rows)


def write_ply(path: Path) -> None:
    columns = "property float x\nproperty float y\nproperty float z\n"
    write_lines(path, f"ply\nformat ascii 1.0\nelement vertex {len(CLOUD)}\n{columns}end_header\n")


def write_pcd(path: Path) -> None:
    count = len(CLOUD)
    fields = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    write_lines(path, f"{fields}WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA ascii\n")


def write_h5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["points"] = CLOUD


def write_ptx(path: Path) -> None:
    lines = f"{len(CLOUD)}\n1\n" + "0 0 0\n1 0 0\n0 1 0\n0 0 1\n" + "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    rows = "".join(f"{x} {y} {z} 0.5\n" for x, y, z in CLOUD + 1)  # a cell at the scanner itself measured nothing
    path.write_text(lines.replace("0 0 0 1\n", "-1 -1 -1 1\n") + rows)


def write_sweep(path: Path) -> None:
    np.column_stack([CLOUD, np.full(len(CLOUD), 0.5)]).astype("<f4").tofile(path)


def write_las(path: Path) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, 1e-3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = CLOUD.T
    las.write(str(path))


def write_e57(path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(dict(zip(("cartesianX", "cartesianY", "cartesianZ"), CLOUD.T.copy(), strict=True)))
    file.close()


def write_stl(path: Path) -> None:
    path.write_bytes(trimesh.Trimesh(CLOUD, [[0, 1, 2], [2, 3, 4]], process=False).export(file_type="stl"))


EXAMPLES: dict[str, tuple[str, Callable[[Path], object], bytes]] = {
    "ply": (".ply", write_ply, LYING_PLY),
    "pcd": (".pcd", write_pcd, LYING_PCD),
    "text": (".xyz", write_lines, b"no numbers at all\nnor here\n"),
    "vertices": (".obj", lambda path: write_lines(path, prefix="v "), b"v one two three\n"),
    "numpy": (".npy", lambda path: np.save(path, CLOUD), b"\x93NUMPY and then nothing of the kind"),
    "las": (".las", write_las, b"LASF" + bytes(60)),
    "e57": (".e57", write_e57, b"ASTM-E57" + bytes(60)),
    "h5": (".h5", write_h5, b"\x89HDF\r\n\x1a\n" + bytes(60)),
    "ptx": (".ptx", write_ptx, b"five columns\nand one row\n"),
    "sweeps": (".bin", write_sweep, bytes(range(1, 18))),
    "vtk": (".vtk", lambda path: path.write_bytes(legacy(CLOUD, binary=True)), b"# vtk DataFile Version 3.0\n"),
    "meshes": (".stl", write_stl, bytes(80) + b"\xff\xff\xff\x7f" + bytes(50)),
}
"""Reader -> suffix, what writes an example, and the bytes of a file it must refuse."""


NETWORKS: dict[str, dict[str, Any]] = {
    "unshuffle_unet": {"widths": (16, 16, 24, 32), "mapping": 24},
    "adain_unet": {"kind": "adain_unet", "unshuffle": 1, "widths": (8, 12, 16), "encoder": "none"},
}
"""Kind of network -> the shape that engines are tried on."""


@pytest.fixture(scope="session")
def exported(make_weights: Callable[..., Path]) -> Callable[[str], TrainedNetwork]:
    """Function that gives a network of random weights and its export."""

    @cache
    def export(kind: str) -> TrainedNetwork:
        file = make_weights(**NETWORKS[kind])
        loaded, onnx = load_plugins(file), export_onnx(file).read_bytes()
        channels, settings, rng = (loaded.buffer_channels, loaded.encoder.channels), loaded.settings, default_rng(0)
        shapes = (1, channels[0], 64, 64), (channels[1], *([64 // loaded.config.unshuffle] * 2)), (1, settings)
        calibration = [tuple(rng.random(shape, dtype=np.float32) for shape in shapes) for _ in range(4)]
        return TrainedNetwork(*channels, settings, onnx, loaded.build, quantize_int8(onnx, calibration))

    return export


@pytest.mark.parametrize("name", registry.names("controls"))
def test_control(name: str) -> None:
    check_control(registry.load("controls", name))


@pytest.mark.parametrize("name", registry.names("zbuffers"))
def test_zbuffer(name: str) -> None:
    check_zbuffer(registry.load("zbuffers", name))


@pytest.mark.parametrize("name", registry.names("gbuffers"))
def test_gbuffer(name: str) -> None:
    check_gbuffer(registry.load("gbuffers", name))


@pytest.mark.parametrize("name", registry.names("encoders"))
def test_encoder(name: str) -> None:
    check_encoder(registry.load("encoders", name))


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.names("engines"))
@pytest.mark.parametrize("kind", NETWORKS)
def test_engine(name: str, kind: str, exported: Callable[[str], TrainedNetwork]) -> None:
    engine = registry.load("engines", name)
    if not engine.installed():
        pytest.skip(f"{engine.package} is not installed")
    check_engine(engine, exported(kind), cell=NETWORKS[kind].get("unshuffle", 4))


@pytest.mark.parametrize("name", registry.names("samplers"))
def test_sampler(name: str) -> None:
    check_sampler(registry.load("samplers", name))


@pytest.mark.parametrize("name", registry.names("conditions"))
def test_conditions(name):
    check_condition(registry.load("conditions", name))


@pytest.mark.parametrize("name", registry.names("textures"))
def test_texture(name: str) -> None:
    check_texture(registry.load("textures", name))


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.names("baselines"))
def test_baseline(name: str) -> None:
    check_baseline(registry.load("baselines", name))


@pytest.mark.parametrize("name", registry.names("painters"))
def test_painter(name: str) -> None:
    check_painter(registry.load("painters", name))


@pytest.mark.parametrize("name", registry.names("readers"))
def test_reader(name: str, tmp_path: Path) -> None:
    if name not in EXAMPLES:
        pytest.skip(f"no example file of the {name} reader, which another package brings")
    suffix, write, broken = EXAMPLES[name]
    example, lie = tmp_path / f"example{suffix}", tmp_path / f"broken{suffix}"
    write(example)
    lie.write_bytes(broken)
    reader: type[Reader] = registry.load("readers", name)
    check_reader(reader, example, lie)
    (cloud,) = reader().read(example)
    np.testing.assert_allclose(getattr(cloud, "points", cloud), CLOUD, atol=1e-3)


def test_every_built_in_reader_has_an_example() -> None:
    built_in = {plugin.name for plugin in registry.installed("readers") if plugin.origin.startswith("z2p-renderer ")}
    assert built_in == set(EXAMPLES)


@pytest.mark.parametrize("group", registry.GROUPS)
def test_every_group_has_a_built_in(group: str) -> None:
    assert any(plugin.origin.startswith("z2p-renderer ") for plugin in registry.installed(group))
