"""Training: it learns, it resumes to the bit, and its weights load and draw."""

import csv
import shutil
from dataclasses import replace
from itertools import pairwise

import numpy as np
import onnxruntime
import pytest
import torch
from PIL import Image
from sphere_shards import sphere_shard

from z2p_core.camera import Camera
from z2p_core.config import LossConfig, NetworkConfig, TrainConfig
from z2p_core.registry import PluginError
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.inference.input_buffers import draw_buffers
from z2p_renderer.pipeline.inference.loading import load_network, load_plugins
from z2p_renderer.pipeline.training.state import TrainError
from z2p_renderer.pipeline.training.train import learning_rate, train
from z2p_renderer.storage.models.checkpoints import (
    CHECKPOINT,
    PREVIOUS_CHECKPOINT,
    Weights,
    WeightsError,
    load_weights,
    save_weights,
)

NETWORK = NetworkConfig(widths=(16, 24, 32), mapping=32, encoder="fourier")
CONFIG = TrainConfig(
    network=NETWORK, steps=6, batch=2, warmup=2, points=(200, 800), validate_every=3, checkpoint_every=1
)
SIDE = 32


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    return [sphere_shard(folder / f"{seed}.h5", 10, SIDE, seed) for seed in range(2)]


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def silent(line):
    pass


def stopping_at(words):
    """A log that interrupts the run when a line starts with these words."""

    def log(line):
        if line.startswith(words):
            raise KeyboardInterrupt

    return log


def rows_of(out):
    with (out / "curve.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def undisturbed(shards, tmp_path_factory):
    torch.set_num_threads(1)
    out = tmp_path_factory.mktemp("undisturbed")
    train(shards, CONFIG, out, log=silent, precision="float32")
    return out


@pytest.mark.slow
@pytest.mark.parametrize("stop", ["step 3: checkpoint", "step 3: validation", "step 5: checkpoint"])
def test_killed_run_resumes_bit_identically(shards, undisturbed, tmp_path, stop):
    with pytest.raises(KeyboardInterrupt):
        train(shards, CONFIG, tmp_path, log=stopping_at(stop), precision="float32")
    assert not (tmp_path / "weights.safetensors").exists()
    lines = []
    train(shards, CONFIG, tmp_path, log=lines.append)  # takes up the precision as well
    assert any(line.startswith("going on from step") for line in lines)
    for name in ("weights.safetensors", "curve.csv", "validation/step_000006.png"):
        assert (tmp_path / name).read_bytes() == (undisturbed / name).read_bytes()


@pytest.mark.slow
def test_a_damaged_newest_checkpoint_falls_back(shards, undisturbed, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        train(shards, CONFIG, tmp_path, log=stopping_at("step 4: checkpoint"), precision="float32")
    newest = tmp_path / "checkpoints" / CHECKPOINT
    newest.write_bytes(newest.read_bytes()[:-100])
    lines = []
    train(shards, CONFIG, tmp_path, log=lines.append)
    assert any(line.startswith("warning: ignored a checkpoint") for line in lines)
    assert "going on from step 3" in lines
    assert (tmp_path / "weights.safetensors").read_bytes() == (undisturbed / "weights.safetensors").read_bytes()


def test_training_writes_all_its_files(undisturbed):
    names = {path.relative_to(undisturbed).as_posix() for path in undisturbed.rglob("*") if path.is_file()}
    assert names == {
        "weights.safetensors", "weights.onnx", "curve.csv", "curve.png", "validation/step_000003.png",
        "validation/step_000006.png",
        f"checkpoints/{CHECKPOINT}", f"checkpoints/{PREVIOUS_CHECKPOINT}",
    }  # fmt: skip
    rows = rows_of(undisturbed)
    assert [int(float(row["step"])) for row in rows] == [1, 2, 3, 4, 5, 6]
    assert [bool(row["validation_psnr_white"]) for row in rows] == [False, False, True, False, False, True]
    assert all(float(row["loss"]) > 0 for row in rows)
    assert Image.open(undisturbed / "validation/step_000006.png").size == (3 * SIDE, SIDE)  # one held out


def test_the_weights_load_and_draw_what_the_card_says(undisturbed):
    loaded = load_network(undisturbed / "weights.safetensors")
    assert list(loaded.controls) == ["color", "light", "elevation"]
    assert loaded.card["resolution"] == [SIDE] and loaded.card["fixed_elevation"] is None
    assert len(loaded.card["encoder"]["state"]["omega"]) == 10
    camera = Camera(40, 36)
    cloud = np.random.default_rng(0).uniform(-0.5, 0.5, (500, 3)).astype(np.float32)
    with torch.no_grad():
        picture = loaded.network(
            torch.from_numpy(draw_buffers(cloud, camera, SceneDescription(), loaded.zbuffer, loaded.gbuffer))[None],
            torch.from_numpy(loaded.encoder.encode(*camera.frame_coordinates(4))),
            torch.full((1, 7), 0.5),
        )
    assert picture.shape == (1, 4, 36, 40) and picture.isfinite().all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "network, loss",
    [
        (NETWORK, LossConfig()),
        (
            NetworkConfig("adain_unet", (8, 12, 16), unshuffle=1, mapping=32, zbuffer="paper", gbuffer="none"),
            LossConfig(1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, masked=True),
        ),
    ],
    ids=["fast", "paper"],
)
@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_thirty_steps_lower_the_loss(shards, tmp_path, network, loss, precision):
    config = replace(
        CONFIG, network=network, loss=loss, steps=30, batch=4, learning_rate=3e-3, warmup=3, average=0.8,
        validate_every=30, checkpoint_every=30,
    )  # fmt: skip
    train(shards, config, tmp_path, log=silent, precision=precision)
    losses = [float(row["loss"]) for row in rows_of(tmp_path)]
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:3])


@pytest.mark.slow
def test_cropped_training_is_recorded_in_the_card(tmp_path):
    shards = [sphere_shard(tmp_path / "spheres.h5", 6, 128, 0)]
    config = replace(CONFIG, steps=2, cropped=True)
    weights = train(shards, config, tmp_path / "run", log=silent)
    assert load_plugins(weights).card["training"]["cropped"] is True


def test_another_run_in_the_same_folder_is_refused(shards, undisturbed, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        train(shards, CONFIG, tmp_path, log=stopping_at("step 1: checkpoint"), precision="float32")
    for other in (replace(CONFIG, steps=7), replace(CONFIG, seed=1)):
        with pytest.raises(TrainError, match="another config or other shards"):
            train(shards, other, tmp_path, log=silent)
    with pytest.raises(TrainError, match="another config or other shards"):
        train(shards[:1], CONFIG, tmp_path, log=silent)


@pytest.mark.slow
def test_run_resumes_after_its_start_weights_were_moved(shards, undisturbed, tmp_path):
    (tmp_path / "a").mkdir()
    first = replace(CONFIG, start=str(tmp_path / "a" / "start.safetensors"))
    shutil.copy(undisturbed / "weights.safetensors", first.start)
    with pytest.raises(KeyboardInterrupt):
        train(shards, first, tmp_path / "run", log=stopping_at("step 3: checkpoint"), precision="float32")
    (tmp_path / "a").rename(tmp_path / "b")
    moved, lines = replace(CONFIG, start=str(tmp_path / "b" / "start.safetensors")), []
    train(shards, moved, tmp_path / "run", log=lines.append)
    assert any(line.startswith("going on from step") for line in lines)


def test_a_loss_that_is_not_finite_stops_the_run(shards, tmp_path):
    with pytest.raises(TrainError, match="lower learning_rate"):
        train(shards, replace(CONFIG, learning_rate=1e30, warmup=0, steps=40), tmp_path, log=silent)
    assert not (tmp_path / "weights.safetensors").exists()


def test_impossible_configs_are_refused(shards, tmp_path):
    with pytest.raises(ValueError, match="steps: expected 1 or more, got 0"):
        train(shards, replace(CONFIG, steps=0), tmp_path, log=silent)
    with pytest.raises(PluginError, match="unknown zbuffer 'deep'"):
        train(shards, replace(CONFIG, network=replace(NETWORK, zbuffer="deep")), tmp_path, log=silent)
    with pytest.raises(ValueError, match="precision: expected"):
        train(shards, CONFIG, tmp_path, log=silent, precision="half")


def test_learning_rate_warms_up_and_falls_to_a_hundredth():
    config = TrainConfig(steps=100, warmup=10, learning_rate=2.0)
    rates = [learning_rate(step, config) for step in range(100)]
    assert rates[0] == pytest.approx(0.2) and max(rates) == pytest.approx(2.0) == rates[10]
    assert all(later <= earlier for earlier, later in pairwise(rates[10:]))
    assert 0.02 <= rates[-1] < 0.025


def test_weights_for_other_plugins_or_shapes_are_refused(undisturbed, tmp_path):
    weights = load_weights(undisturbed / "weights.safetensors")

    def loading(**changes):
        return load_network(Weights(weights.tensors, {**weights.card, **changes}))

    controls = weights.card["controls"]
    with pytest.raises(WeightsError, match="control 'color' 4 settings, the installed one has 3"):
        loading(controls=[{**controls[0], "size": 4}, *controls[1:]])
    with pytest.raises(WeightsError, match="zbuffer 'splats' version 0"):
        loading(zbuffer={"name": "splats", "version": "0"})
    with pytest.raises(PluginError, match="unknown control 'colour'"):
        loading(controls=[{**controls[0], "name": "colour"}, *controls[1:]])
    with pytest.raises(WeightsError, match="expected shape"):
        loading(controls=controls[:2])
    with pytest.raises(WeightsError, match="unknown network 'unet'"):
        loading(network={**weights.card["network"], "kind": "unet"})
    with pytest.raises(WeightsError, match="missing"):
        loading(network={**weights.card["network"], "widths": [16, 24, 32, 48]})


def test_half_weights_draw_nearly_the_same(undisturbed, tmp_path):
    weights = load_weights(undisturbed / "weights.safetensors")
    save_weights(tmp_path / "half.safetensors", weights.tensors, weights.card, half=True)
    size = (tmp_path / "half.safetensors").stat().st_size
    assert size < 0.6 * (undisturbed / "weights.safetensors").stat().st_size
    loaded = load_plugins(weights)
    encoding = torch.rand(loaded.encoder.channels, 8, 8)
    inputs = torch.rand(1, loaded.buffer_channels, 32, 32), encoding, torch.rand(1, loaded.settings)
    with torch.no_grad():
        full, half = (load_network(path).network(*inputs) for path in
                       (undisturbed / "weights.safetensors", tmp_path / "half.safetensors"))
    torch.testing.assert_close(full, half, atol=5e-3, rtol=0)


def test_fine_tuning_goes_on_from_the_weights_and_their_encoder(undisturbed, shards, tmp_path):
    start = undisturbed / "weights.safetensors"
    tuned = replace(CONFIG, start=str(start), steps=1, learning_rate=1e-9, average=0.0, seed=5)
    weights = load_weights(train(shards, tuned, tmp_path, log=silent))
    before = load_weights(start)
    assert weights.card["encoder"] == before.card["encoder"]  # not drawn anew, though the seed is another
    for name, tensor in weights.tensors.items():
        np.testing.assert_allclose(tensor, before.tensors[name], atol=1e-6)


@pytest.mark.slow
def test_fine_tuning_accepts_weights_of_earlier_gbuffers(undisturbed, shards, tmp_path):
    before = load_weights(undisturbed / "weights.safetensors")
    network = {name: value for name, value in before.card["network"].items() if name != "conditioning"}
    card = {**before.card, "network": network, "gbuffer": {"name": "surfels", "version": "0"}}
    save_weights(tmp_path / "earlier.safetensors", before.tensors, card)
    train(shards, replace(CONFIG, start=str(tmp_path / "earlier.safetensors"), steps=1), tmp_path, log=silent)


def test_input_conditioning_trains_and_reloads(shards, tmp_path):
    path = train(shards, replace(CONFIG, network=replace(NETWORK, conditioning="input"), steps=1), tmp_path, log=silent)
    assert load_weights(path).card["network"]["conditioning"] == "input"
    loaded = load_plugins(path)
    network = loaded.build()
    buffers, encoding = torch.rand(1, loaded.buffer_channels, 32, 32), torch.rand(loaded.encoder.channels, 8, 8)
    settings = torch.rand(1, loaded.settings)
    with torch.no_grad():
        picture = network(buffers, encoding, settings).numpy()
    inputs = {"buffers": buffers.numpy(), "encoding": encoding.numpy(), "settings": settings.numpy()}
    session = onnxruntime.InferenceSession(tmp_path / "weights.onnx", providers=["CPUExecutionProvider"])
    np.testing.assert_allclose(session.run(None, inputs)[0], picture, atol=1e-4)


def test_fine_tuning_adds_controls_without_effect_at_first(undisturbed, tmp_path):
    start = undisturbed / "weights.safetensors"
    more = [sphere_shard(tmp_path / "more.h5", 10, SIDE, 0, metallic=True)]
    tuned = replace(CONFIG, start=str(start), steps=1, learning_rate=1e-9, average=0.0)
    weights = load_weights(train(more, tuned, tmp_path, log=silent))
    assert [entry["name"] for entry in weights.card["controls"]] == ["color", "light", "elevation", "metallic"]
    old, new = (load_network(file).network for file in (start, tmp_path / "weights.safetensors"))
    loaded = load_plugins(load_weights(start))
    encoding, settings = torch.rand(loaded.encoder.channels, 8, 8), torch.rand(1, loaded.settings)
    buffers = torch.rand(1, loaded.buffer_channels, 32, 32)
    with torch.no_grad():
        before = old(buffers, encoding, settings)
        for metallic in (0.0, 1.0):
            after = new(buffers, encoding, torch.cat([settings, torch.tensor([[metallic]])], dim=1))
            torch.testing.assert_close(after, before, atol=1e-5, rtol=0)


def test_fine_tuning_accepts_a_refining_gbuffer_and_no_other(
    undisturbed, shards, tmp_path
):
    start = undisturbed / "weights.safetensors"
    shining = replace(CONFIG, network=replace(NETWORK, gbuffer="glossy"), start=str(start), steps=1)
    grown = train(shards, shining, tmp_path, log=silent)
    assert load_weights(grown).card["gbuffer"]["name"] == "glossy"
    with pytest.raises(TrainError, match=r"'gbuffer': 'surfels'.*got .*'gbuffer': 'glossy'"):
        train(shards, replace(CONFIG, start=str(grown), steps=1), tmp_path / "back", log=silent)


def test_weights_of_another_network_are_not_fine_tuned(undisturbed, shards, tmp_path):
    other = replace(CONFIG, start=str(undisturbed / "weights.safetensors"), network=replace(NETWORK, widths=(16, 24)))
    with pytest.raises(TrainError, match=r"train.start: expected weights whose network is .*16, 24.*got .*32"):
        train(shards, other, tmp_path, log=silent)
