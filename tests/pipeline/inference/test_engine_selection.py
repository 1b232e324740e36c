"""Engines in the whole path: which one runs, that it draws what torch draws, and that torch stays away."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import onnx
import pytest
from click.testing import Result
from place_cloud import place_cloud

import z2p_renderer.plugins.engines.onnxruntime
from z2p_core import registry
from z2p_core.registry import PluginError
from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.inference.engine_selection import start_engine
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import WeightsError, find_weights, load_weights, save_weights
from z2p_renderer.storage.models.onnx_files import onnx_path

KNOWN = {name: registry.load("engines", name) for name in registry.names("engines")}
ONNX_ENGINES = [name for name, engine in KNOWN.items() if engine.reads_onnx and engine.exact]
WHOLE = [name for name, engine in KNOWN.items() if not engine.reads_int8]
INT8_ENGINES = [name for name, engine in KNOWN.items() if engine.reads_int8]


@pytest.fixture(scope="module")
def exported_weights(tiny_weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = Path(shutil.copy(tiny_weights, tmp_path_factory.mktemp("exported")))
    export_onnx(file)
    return file


@pytest.fixture
def copied(exported_weights: Path, tmp_path: Path) -> Path:
    """Weights and export that a test may spoil."""
    shutil.copy(onnx_path(exported_weights), tmp_path)
    return Path(shutil.copy(exported_weights, tmp_path))


@pytest.mark.parametrize("engine", ONNX_ENGINES)
@pytest.mark.parametrize(("width", "height"), [(64, 64), (97, 61), (33, 130), (200, 120)])
def test_pictures_are_torchs(exported_weights: Path, cloud: np.ndarray, engine: str, width: int, height: int) -> None:
    placed = place_cloud(cloud)
    expected = Renderer(exported_weights, engine="torch").render(placed, None, width, height)
    renderer = Renderer(exported_weights, threads=1, engine=engine)
    assert renderer.engine == engine
    picture = renderer.render(placed, None, width, height)
    off = np.abs(picture.astype(int) - expected)[expected[..., 3] > 25]  # straight colour means little where alpha does
    assert np.quantile(off, 0.999) <= 2 and expected[..., 3].std() > 10


@pytest.mark.parametrize("engine", ONNX_ENGINES)
def test_a_network_without_encoding_runs_too(make_weights: Callable[..., Path], cloud: np.ndarray, engine: str) -> None:
    file = make_weights(encoder="none")
    given = onnx.load(export_onnx(file)).graph.input
    assert [one.name for one in given] == ["buffers", "settings"]
    ours, torchs = (Renderer(file, engine=name).render(cloud, None, 64, 64).astype(int) for name in (engine, "torch"))
    assert np.abs(ours - torchs).max() <= 2


@pytest.mark.slow
@pytest.mark.parametrize("engine", [name for name in WHOLE if name != "torch"])
def test_one_engine_draws_many_sizes_also_at_a_time(exported_weights: Path, cloud: np.ndarray, engine: str) -> None:
    placed, sides = place_cloud(cloud), [32, 64, 96, 40, 128, 72]  # more than an engine keeps networks for
    renderer = Renderer(exported_weights, threads=1, engine=engine)
    first = [renderer.render(placed, None, side, side) for side in sides]
    with ThreadPoolExecutor(4) as threads:
        again = list(threads.map(lambda side: renderer.render(placed, None, side, side), sides * 3))
    assert all(np.array_equal(*pair) for pair in zip(first * 3, again, strict=True))


def test_the_lowest_rank_that_can_runs(exported_weights: Path, tiny_weights: Path) -> None:
    assert Renderer(exported_weights).engine == "onnxruntime"
    assert Renderer(tiny_weights).engine == "torch"  # there is no export beside them


def test_a_missing_engine_is_skipped_or_refused_if_named(
    exported_weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.load("engines", "onnxruntime"), "package", "no_such_package")
    assert Renderer(exported_weights).engine == "openvino"
    with pytest.raises(PluginError, match=r'needs no_such_package, .* clone of z2p: pip install -c .* "\."$'):
        Renderer(exported_weights, engine="onnxruntime")


def test_without_torch_and_export_the_message_says_how_to_get_on(
    tiny_weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.load("engines", "torch"), "package", "no_such_package")
    told = r"tiny.onnx beside it, or torch; .* python -m z2p_renderer.pipeline.export .*in a clone of z2p: .*\[torch\]"
    with pytest.raises(WeightsError, match=told):
        Renderer(tiny_weights)
    with pytest.raises(WeightsError, match=r"'onnxruntime' needs tiny.onnx beside"):
        Renderer(tiny_weights, engine="onnxruntime")


@pytest.mark.parametrize("engine", INT8_ENGINES)
def test_an_engine_in_8_bits_needs_a_graph_of_its_own(exported_weights: Path, engine: str) -> None:
    with pytest.raises(WeightsError, match=rf"'{engine}' needs tiny.int8.graph beside .* choose another engine"):
        Renderer(exported_weights, engine=engine)


def test_no_engine_that_is_less_exact_runs_unasked(exported_weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for engine in KNOWN.values():
        if engine.exact:
            monkeypatch.setattr(engine, "package", "no_such_package")
    monkeypatch.setattr(KNOWN["openvino-bf16"], "package", "openvino")
    with pytest.raises(WeightsError, match="or torch"):
        Renderer(exported_weights)
    assert Renderer(exported_weights, engine="openvino-bf16").engine == "openvino-bf16"


@pytest.mark.parametrize(
    ("flags", "engine"),
    [("fpu avx2 avx512_vnni", "onnxruntime-int8"), ("fma avx2 bmi1", "onnxruntime-int8"),
     ("sse4_2 avx avx2x", "onnxruntime"), (None, "onnxruntime")],
)  # fmt: skip
def test_int8_is_the_default_only_on_cpus_with_byte_dot_products(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: str | None, engine: str
) -> None:
    told = tmp_path / "cpuinfo"
    if flags is not None:
        told.write_text(f"model name\t: one of these\nflags\t\t: {flags}\n")
    monkeypatch.setattr(z2p_renderer.plugins.engines.onnxruntime, "CPU_INFO", told)
    z2p_renderer.plugins.engines.onnxruntime.multiplies_bytes.cache_clear()
    file = find_weights("regular")
    loaded = load_plugins(file)
    assert start_engine(loaded, file).name == engine
    assert start_engine(loaded, file, exact=True).name == "onnxruntime"
    z2p_renderer.plugins.engines.onnxruntime.multiplies_bytes.cache_clear()


def test_an_unknown_engine_is_told_with_the_known_ones(exported_weights: Path) -> None:
    with pytest.raises(PluginError, match=r"unknown engine 'abacus'; installed: onnxruntime, .*openvino, .*torch"):
        Renderer(exported_weights, engine="abacus")


def test_an_export_of_other_weights_is_refused(copied: Path) -> None:
    weights = load_weights(copied)
    name, tensor = next(iter(weights.tensors.items()))
    save_weights(copied, {**weights.tensors, name: tensor + 1}, weights.card)
    with pytest.raises(WeightsError, match=r"tiny.onnx: made from other weights than tiny.safetensors"):
        Renderer(copied)
    export_onnx(copied)
    assert Renderer(copied).engine == "onnxruntime"


RACE = """
import sys, threading
import numpy as np
from z2p_renderer.pipeline.inference.renderer import Renderer

renderer = Renderer(sys.argv[1], threads=1, engine=sys.argv[2])
cloud = np.random.default_rng(0).normal(size=(300, 3)).astype(np.float32) * 0.3
inputs = renderer.inputs(cloud, None, 64, 64)
engine, gate, pictures = renderer._engine, threading.Barrier(2), []
if hasattr(engine, "_request"):  # compiled before, so that the threads come to their first run together
    named = dict(zip(("buffers", "encoding", "settings"), inputs))
    engine._request({name: named[name] for name in engine._reads})

def first():
    gate.wait()
    pictures.append(engine.run(*inputs))

sys.setswitchinterval(1e-6)
threads = [threading.Thread(target=first) for _ in range(2)]
[thread.start() for thread in threads], [thread.join() for thread in threads]
assert len(pictures) == 2 and np.array_equal(*pictures)
"""


@pytest.mark.slow
@pytest.mark.parametrize("engine", ONNX_ENGINES)
def test_first_runs_at_the_same_time_end(exported_weights: Path, engine: str) -> None:
    for _ in range(3):  # OpenVINO without its lock stands still every other time
        done = subprocess.run([sys.executable, "-c", RACE, str(exported_weights), engine], capture_output=True,
                              text=True, timeout=60)  # fmt: skip
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("place", [100, -200, -300])
def test_a_flipped_bit_is_noticed(copied: Path, place: int) -> None:
    content = bytearray(onnx_path(copied).read_bytes())
    content[place] ^= 1
    onnx_path(copied).write_bytes(content)
    with pytest.raises(WeightsError, match="damaged"):
        Renderer(copied)


@pytest.mark.parametrize("left", [0, 50, -1])
def test_a_truncated_export_is_refused(copied: Path, left: int) -> None:
    content = onnx_path(copied).read_bytes()
    onnx_path(copied).write_bytes(content[:left])
    with pytest.raises(WeightsError, match="damaged"):
        Renderer(copied)


def test_a_link_to_weights_uses_the_export_of_its_target(copied: Path, tmp_path: Path) -> None:
    link = tmp_path / "elsewhere" / "linked.safetensors"
    link.parent.mkdir()
    link.symlink_to(copied)
    assert Renderer(link).engine == "onnxruntime"


@pytest.mark.slow
def test_the_command_never_imports_torch(exported_weights: Path, scans: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from z2p_renderer.pipeline.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit as end: assert end.code == 0, end\n"
        "heavy = {'torch', 'onnx', 'openvino', 'kornia', 'h5py', 'open3d'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    words = ("run-inference", scans, "-o", tmp_path / "out", "--weights", exported_weights, "--resolution", "64")
    done = subprocess.run([sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out").glob("*.png"))) == 2


@pytest.mark.slow
def test_no_library_leaves_or_sends_anything_of_its_own(exported_weights: Path, scans: Path, tmp_path: Path) -> None:
    home, words = tmp_path / "home", ["run-inference", str(scans), "-o", str(tmp_path / "out"), "--resolution", "64"]
    home.mkdir()
    env = {name: text for name, text in os.environ.items() if not name.startswith(("ORT_", "XDG_"))}
    for command in (["cli", *words, "--engine", "onnxruntime"], ["export", str(exported_weights)]):
        words = [sys.executable, "-m", f"z2p_renderer.pipeline.{command[0]}", *command[1:]]
        done = subprocess.run(words, env={**env, "HOME": str(home)}, capture_output=True)
        assert done.returncode == 0, done.stderr
    assert not list(home.rglob("*"))


@pytest.mark.slow
def test_python_never_imports_torch_either(exported_weights: Path) -> None:
    code = (
        "import sys, numpy, z2p_core\n"
        "points = numpy.random.default_rng(0).normal(size=(200, 3))\n"
        "assert z2p_core.render(points, size=64, weights=sys.argv[1]).array.shape == (64, 64, 4)\n"
        "assert 'torch' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code, str(exported_weights)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_option_forces_it(z2p: Callable[..., Result], exported_weights: Path, scans: Path, tmp_path: Path) -> None:
    words = ("run-inference", scans / "one.npy", "--weights", exported_weights, "--resolution", 64, "-o")
    for engine in WHOLE:
        result = z2p(*words, tmp_path / f"{engine}.png", "--engine", engine)
        assert result.exit_code == 0, result.output
    refused = z2p(*words, tmp_path / "abacus.png", "--engine", "abacus")
    assert refused.exit_code == 2 and "unknown engine 'abacus'" in refused.stderr


def test_compiled_models_are_cached_unless_caching_is_off(
    exported_weights: Path, cloud: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openvino")

    def picture() -> np.ndarray:
        return Renderer(exported_weights, threads=1, engine="openvino").render(place_cloud(cloud), None, 64, 64)

    expected = picture()
    monkeypatch.setenv("Z2P_CACHE", str(tmp_path / "cache"))
    np.testing.assert_array_equal(picture(), expected)
    (kept,) = (tmp_path / "cache").iterdir()
    before = kept.stat().st_ino
    np.testing.assert_array_equal(picture(), expected)
    assert [path.stat().st_ino for path in (tmp_path / "cache").iterdir()] == [before]  # read, not written again


def test_fp16_exports_are_small_and_fp32_exports_exact(make_weights: Callable[..., Path]) -> None:
    whole = make_weights(widths=(32, 48), mapping=64)
    weights = load_weights(whole)
    half = whole.with_name("half.safetensors")
    save_weights(half, weights.tensors, weights.card, half=True)
    small, large = (export_onnx(file).stat().st_size for file in (half, whole))
    size = sum(tensor.size for tensor in weights.tensors.values())
    assert small < 2 * size + 60_000 < 4 * size < large


def test_a_missing_exporter_is_told_before_a_training(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from z2p_core.config import TrainConfig
    from z2p_renderer.pipeline.training.train import train

    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "onnx" else True)
    with pytest.raises(ImportError, match=r"onnx must be installed; to get it, in a clone of z2p: .*\[pipeline\]"):
        train([], TrainConfig(), tmp_path)
