"""The training stage: shards in; weights, learning curve, validation images and checkpoints out."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from z2p_core.config.pipeline import TrainConfig, samples_until
from z2p_core.quality.losses import total_loss
from z2p_core.quality.validation_metrics import validation_metrics
from z2p_renderer.pipeline.export import check_exporter, export_onnx
from z2p_renderer.pipeline.training.cropping import crop_batch
from z2p_renderer.pipeline.training.dataset import Batch
from z2p_renderer.pipeline.training.learning_curve import Row, write_learning_curve, write_validation_strip
from z2p_renderer.pipeline.training.state import (
    TrainError,
    TrainingState,
    checkpoint_content,
    resume_from_checkpoint,
    start_training,
    weights_card,
)
from z2p_renderer.pipeline.training.textured_samples import multiply_radiance
from z2p_renderer.storage.models.checkpoints import save_checkpoint, save_weights

MAX_GRADIENT_NORM = 1.0
"""Gradients are clipped to this L2 norm."""
CROP_SEED = 5
"""First word of the crops' seed; differs from those in `pipeline.training.dataset` and `pipeline.training.state`."""
FINAL_RATE_SHARE = 0.01
"""Learning rate of the last step, as a share of the highest."""
VALIDATION_IMAGES = 32
"""Most held-out renders that one validation measures."""
STRIP_IMAGES = 4
"""Rows of a validation strip."""
MAX_CURVE_ROWS = 400
"""Training losses are averaged to about so many rows of the curve."""
LOG_SECONDS = 30.0
"""Time between lines of progress where stderr is no terminal."""


def train(
    shards: Sequence[Path],
    config: TrainConfig,
    out: Path,
    *,
    device: str = "auto",
    threads: int | None = None,
    precision: str = "auto",
    log: Callable[[str], object] | None = None,
) -> Path:
    """Trains on the shards and writes `out/weights.safetensors`: the exponential moving average of the weights.

    Also writes `weights.onnx` (the same network, for engines without torch), `curve.csv`, `curve.png`,
    `validation/step_*.png` (z-buffer, prediction, target) and `checkpoints/`, from which the same call resumes exactly
    where a killed one stopped. `precision` is ``auto`` (the device's fastest), ``float32`` or ``bfloat16`` (autocast).
    `log` takes lines of text; stderr by default.

    Raises:
        TrainError: `out` holds another run's checkpoint, or the loss is no longer finite.
        ShardError, DatasetError, PluginError, ValueError: shards, plugins or the config cannot be used.
    """
    log = log or _to_stderr
    check_exporter()
    if threads is not None:
        torch.set_num_threads(threads)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        state = start_training(shards, config, _choose_device(device), precision)
        resume_from_checkpoint(state, out, log)
        size = sum(parameter.numel() for parameter in state.network.parameters())
        sides = " and ".join(map(str, sorted(set(state.data.sides))))
        log(
            f"training {config.network.kind} ({size / 1e6:.1f} M weights) on {len(state.data.training)} renders of "
            f"{len(state.data.shards)} meshes at {sides} pixels a side, {state.device.type}, {state.precision}, "
            f"steps {state.step} to {config.steps}"
        )
        _train_steps(state, out, log)
        weights = out / "weights.safetensors"
        save_weights(weights, state.average.state_dict(), weights_card(state))
        exported = export_onnx(weights)
    log(f"wrote {weights} and {exported.name}")
    return weights


def _train_steps(state: TrainingState, out: Path, log: Callable[[str], object]) -> None:
    config = state.config
    every = max(1, config.steps // MAX_CURVE_ROWS)
    progress = _Progress(state.step, config.steps, partial(_samples_seen, state), log)
    with state.data.batches(state.step, config.steps) as batches, progress.bar:
        for batch in batches:
            state.recent_losses.append(_train_step(state, batch.to(state.device)))
            state.step += 1
            last = state.step == config.steps
            progress.show(state.step, state.recent_losses[-1]["loss"])
            if state.step % every == 0 or last:
                _add_curve_row(state)
            if state.step % config.validate_every == 0 or last:
                log(_validate(state, out))
                write_learning_curve(out, state.rows)
            if state.step % config.checkpoint_every == 0 or last:
                save_checkpoint(out / "checkpoints", *checkpoint_content(state))
                log(f"step {state.step}: checkpoint")


def _samples_seen(state: TrainingState, step: int) -> int:
    return samples_until(step, state.config.batch, state.data.sides)


def _train_step(state: TrainingState, batch: Batch) -> Row:
    """One optimiser step on a batch; returns the total loss and its terms."""
    rate = learning_rate(state.step, state.config)
    for group in state.optimizer.param_groups:
        group["lr"] = rate
    encoding = state.encodings[batch.buffers.shape[-1]]
    if state.config.cropped:
        rng = np.random.default_rng((CROP_SEED, state.config.seed, state.step))
        network = state.config.network
        channels = state.data.zbuffer.channels
        batch, encoding = crop_batch(batch, encoding, channels, network.stride, network.unshuffle, rng)
    autocast = torch.autocast(state.device.type, torch.bfloat16) if state.precision == "bfloat16" else nullcontext()
    with autocast:
        prediction = state.network(batch.buffers, encoding, batch.settings)
    if batch.factors is not None:
        prediction = multiply_radiance(prediction.float(), batch.factors)
    loss, terms = total_loss(prediction, batch.target, batch.coverage, state.config.loss)
    state.optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(state.network.parameters(), MAX_GRADIENT_NORM)
    row = {"loss": loss.item(), **{name: term.item() for name, term in terms.items()}}
    if not math.isfinite(row["loss"]):
        raise TrainError(f"step {state.step}: the loss is {row['loss']}; lower learning_rate, or check the shards")
    state.optimizer.step()
    # The decay grows with the steps; else early averages would keep the random initialisation for a thousand steps.
    decay = min(state.config.average, (1 + state.step) / (10 + state.step))
    with torch.no_grad():
        torch._foreach_lerp_(list(state.average.parameters()), list(state.network.parameters()), 1 - decay)
    return row


def learning_rate(step: int, config: TrainConfig) -> float:
    """Learning rate of step `step`, counted from 0: linear warm-up, then cosine decay to `FINAL_RATE_SHARE` of it."""
    if step < config.warmup:
        return config.learning_rate * (step + 1) / config.warmup
    done = (step - config.warmup) / max(1, config.steps - config.warmup)
    decay = (1 + math.cos(math.pi * min(1.0, done))) / 2
    return config.learning_rate * (FINAL_RATE_SHARE + (1 - FINAL_RATE_SHARE) * decay)


def _add_curve_row(state: TrainingState) -> None:
    """Adds a row to the curve: means of the losses since the last one."""
    row: Row = {"step": state.step, "samples": _samples_seen(state, state.step)}
    row["learning_rate"] = learning_rate(state.step - 1, state.config)
    for name in state.recent_losses[0]:
        row[name] = float(np.mean([losses[name] for losses in state.recent_losses]))
    state.rows.append(row)
    state.recent_losses = []


def _validate(state: TrainingState, out: Path) -> str:
    """Measures the averaged weights on held-out renders, for the curve, a strip and the log line that it returns."""
    count = min(VALIDATION_IMAGES, len(state.data.validation))
    measured: list[tuple[int, Row]] = []
    for first in range(0, count, state.config.batch):
        numbers = range(first, min(first + state.config.batch, count))
        batch = state.data.validation_batch(numbers).to(state.device)
        with torch.no_grad():
            prediction = state.average(batch.buffers, state.encodings[batch.buffers.shape[-1]], batch.settings)
        if batch.factors is not None:
            prediction = multiply_radiance(prediction, batch.factors)
        measured.append((len(numbers), validation_metrics(prediction, batch.target, batch.coverage)))
        if first == 0:
            strip = (tensor[:STRIP_IMAGES] for tensor in (batch.buffers, prediction, batch.target))
            write_validation_strip(out / "validation" / f"step_{state.step:06d}.png", *strip)
    row = {name: sum(size * metrics[name] for size, metrics in measured) / count for name in measured[0][1]}
    if state.rows and state.rows[-1]["step"] == state.step:
        state.rows[-1].update(row)
    else:
        state.rows.append({"step": state.step, "samples": _samples_seen(state, state.step), **row})
    return f"step {state.step}: " + ", ".join(f"{name} {value:.4g}" for name, value in row.items())


def _choose_device(name: str) -> torch.device:
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


class _Progress:
    """A live progress bar on a terminal; elsewhere a log line every `LOG_SECONDS`."""

    def __init__(self, step: int, steps: int, samples: Callable[[int], int], log: Callable[[str], object]) -> None:
        self.bar = tqdm(total=steps, initial=step, unit="step", disable=not sys.stderr.isatty(), file=sys.stderr)
        self.first, self.steps, self.samples, self.log = step, steps, samples, log
        self.started = self.last_logged = time.monotonic()

    def show(self, step: int, loss: float) -> None:
        now = time.monotonic()
        seconds = max(now - self.started, 1e-9)
        speed = f"{(self.samples(step) - self.samples(self.first)) / seconds:.1f} samples/s"
        self.bar.update()
        self.bar.set_postfix_str(f"{speed}, loss {loss:.4f}", refresh=False)
        if self.bar.disable and now - self.last_logged >= LOG_SECONDS:
            left = (self.steps - step) / (step - self.first) * seconds
            self.log(f"step {step} of {self.steps}: {speed}, loss {loss:.4f}, {left / 60:.1f} min left")
            self.last_logged = now


def _to_stderr(line: str) -> None:
    tqdm.write(line, file=sys.stderr)
    sys.stderr.flush()
