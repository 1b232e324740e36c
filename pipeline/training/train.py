"""The training stage: shards in; weights, learning curve, sample pictures and checkpoints out."""

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
from z2p_renderer.pipeline.export import check_exporter, export_onnx
from z2p_renderer.pipeline.training.cropping import crop_batch
from z2p_renderer.pipeline.training.dataset import Batch
from z2p_renderer.pipeline.training.learning_curve import Row, validation_metrics, write_learning_curve, write_validation_strip
from z2p_renderer.pipeline.training.state import TrainingState, TrainError, resume_from_checkpoint, checkpoint_content, start_training, weights_card
from z2p_renderer.storage.models.checkpoints import save_checkpoint, save_weights

MAX_GRADIENT_NORM = 1.0
CROP_SEED = 5
"""Beside the seeds of `pipeline.training.dataset` and `pipeline.training.state`."""
FINAL_RATE_SHARE = 0.01
"""Learning rate at the end, as a share of the highest."""
VALIDATION_IMAGES, STRIP_IMAGES = 32, 4
MAX_CURVE_ROWS = 400
LOG_SECONDS = 30.0


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
    """`out/weights.safetensors`: weights trained on the shards, averaged over the steps.

    Beside it: `weights.onnx` (the same network, for engines without torch), `curve.csv`, `curve.png`,
    `validation/step_*.png` (z-buffer, prediction, target) and `checkpoints/`, from which the same call goes on exactly
    where a killed one stopped. `precision` is ``auto``, ``float32`` or ``bfloat16``
    (autocast); ``auto`` asks the device. `log` takes lines of text; stderr by default.

    Raises:
        TrainError: `out` holds another run's checkpoint, or the loss stops being finite.
        ShardError, DatasetError, PluginError, ValueError: shards, plugins or config that cannot be used.
    """
    log = log or _to_stderr
    check_exporter()
    if threads is not None:
        torch.set_num_threads(threads)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        run = start_training(shards, config, _choose_device(device), precision)
        resume_from_checkpoint(run, out, log)
        size = sum(parameter.numel() for parameter in run.network.parameters())
        sides = " and ".join(map(str, sorted(set(run.data.sides))))
        log(
            f"training {config.network.kind} ({size / 1e6:.1f} M weights) on {len(run.data.training)} renders of "
            f"{len(run.data.shards)} meshes at {sides} pixels a side, {run.device.type}, {run.precision}, "
            f"steps {run.step} to {config.steps}"
        )
        _train_steps(run, out, log)
        weights = out / "weights.safetensors"
        save_weights(weights, run.average.state_dict(), weights_card(run))
        exported = export_onnx(weights)
    log(f"wrote {weights} and {exported.name}")
    return weights


def _train_steps(run: TrainingState, out: Path, log: Callable[[str], object]) -> None:
    config = run.config
    every = max(1, config.steps // MAX_CURVE_ROWS)
    progress = _Progress(run.step, config.steps, partial(_samples_seen, run), log)
    with run.data.batches(run.step, config.steps) as batches, progress.bar:
        for batch in batches:
            run.recent.append(_train_step(run, batch.to(run.device)))
            run.step += 1
            last = run.step == config.steps
            progress.show(run.step, run.recent[-1]["loss"])
            if run.step % every == 0 or last:
                _add_curve_row(run)
            if run.step % config.validate_every == 0 or last:
                log(_validate(run, out))
                write_learning_curve(out, run.rows)
            if run.step % config.checkpoint_every == 0 or last:
                save_checkpoint(out / "checkpoints", *checkpoint_content(run))
                log(f"step {run.step}: checkpoint")


def _samples_seen(run: TrainingState, step: int) -> int:
    return samples_until(step, run.config.batch, run.data.sides)


def _train_step(run: TrainingState, batch: Batch) -> Row:
    """One step of the optimiser; its losses."""
    rate = learning_rate(run.step, run.config)
    for group in run.optimizer.param_groups:
        group["lr"] = rate
    encoding = run.encodings[batch.buffers.shape[-1]]
    if run.config.cropped:
        rng = np.random.default_rng((CROP_SEED, run.config.seed, run.step))
        network = run.config.network
        batch, encoding = crop_batch(batch, encoding, run.data.zbuffer.channels, network.stride, network.unshuffle, rng)
    autocast = torch.autocast(run.device.type, torch.bfloat16) if run.precision == "bfloat16" else nullcontext()
    with autocast:
        prediction = run.network(batch.buffers, encoding, batch.settings)
    loss, terms = total_loss(prediction, batch.target, batch.coverage, run.config.loss)
    run.optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(run.network.parameters(), MAX_GRADIENT_NORM)
    row = {"loss": loss.item(), **{name: term.item() for name, term in terms.items()}}
    if not math.isfinite(row["loss"]):
        raise TrainError(f"step {run.step}: the loss is {row['loss']}; lower learning_rate, or check the shards")
    run.optimizer.step()
    # Early averages would remember the random start for a thousand steps, so the decay grows with the steps.
    decay = min(run.config.average, (1 + run.step) / (10 + run.step))
    with torch.no_grad():
        torch._foreach_lerp_(list(run.average.parameters()), list(run.network.parameters()), 1 - decay)
    return row


def learning_rate(step: int, config: TrainConfig) -> float:
    """Rate of step `step`, counted from 0: a linear warm-up, then a cosine down to a hundredth."""
    if step < config.warmup:
        return config.learning_rate * (step + 1) / config.warmup
    done = (step - config.warmup) / max(1, config.steps - config.warmup)
    return config.learning_rate * (FINAL_RATE_SHARE + (1 - FINAL_RATE_SHARE) * (1 + math.cos(math.pi * min(1.0, done))) / 2)


def _add_curve_row(run: TrainingState) -> None:
    """A row of the curve: means of the losses since the last one."""
    row: Row = {"step": run.step, "samples": _samples_seen(run, run.step)}
    row["learning_rate"] = learning_rate(run.step - 1, run.config)
    for name in run.recent[0]:
        row[name] = float(np.mean([losses[name] for losses in run.recent]))
    run.rows.append(row)
    run.recent = []


def _validate(run: TrainingState, out: Path) -> str:
    """Measures the average on held-out renders, adds that to the curve and draws a strip; a line for the log."""
    count = min(VALIDATION_IMAGES, len(run.data.validation))
    measured: list[tuple[int, Row]] = []
    for first in range(0, count, run.config.batch):
        numbers = range(first, min(first + run.config.batch, count))
        batch = run.data.validation_batch(numbers).to(run.device)
        with torch.no_grad():
            prediction = run.average(batch.buffers, run.encodings[batch.buffers.shape[-1]], batch.settings)
        measured.append((len(numbers), validation_metrics(prediction, batch.target, batch.coverage)))
        if first == 0:
            strip = (tensor[:STRIP_IMAGES] for tensor in (batch.buffers, prediction, batch.target))
            write_validation_strip(out / "validation" / f"step_{run.step:06d}.png", *strip)
    row = {name: sum(size * metrics[name] for size, metrics in measured) / count for name in measured[0][1]}
    if run.rows and run.rows[-1]["step"] == run.step:
        run.rows[-1].update(row)
    else:
        run.rows.append({"step": run.step, "samples": _samples_seen(run, run.step), **row})
    return f"step {run.step}: " + ", ".join(f"{name} {value:.4g}" for name, value in row.items())


def _choose_device(name: str) -> torch.device:
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


class _Progress:
    """A live bar on a terminal; in a log file, a line every half minute."""

    def __init__(
        self, step: int, steps: int, samples: Callable[[int], int], log: Callable[[str], object]
    ) -> None:
        self.bar = tqdm(total=steps, initial=step, unit="step", disable=not sys.stderr.isatty(), file=sys.stderr)
        self.first, self.steps, self.samples, self.log = step, steps, samples, log
        self.begin = self.said = time.monotonic()

    def show(self, step: int, loss: float) -> None:
        now = time.monotonic()
        seconds = max(now - self.begin, 1e-9)
        speed = f"{(self.samples(step) - self.samples(self.first)) / seconds:.1f} samples/s"
        self.bar.update()
        self.bar.set_postfix_str(f"{speed}, loss {loss:.4f}", refresh=False)
        if self.bar.disable and now - self.said >= LOG_SECONDS:
            left = (self.steps - step) / (step - self.first) * seconds
            self.log(f"step {step} of {self.steps}: {speed}, loss {loss:.4f}, {left / 60:.1f} min left")
            self.said = now


def _to_stderr(line: str) -> None:
    tqdm.write(line, file=sys.stderr)
    sys.stderr.flush()
