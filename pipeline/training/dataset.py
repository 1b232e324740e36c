"""Training batches from shards: a fresh cloud, its buffers, its settings and its target for every sample.

A batch depends on the seed and on its number alone, so a resumed run sees the batches of an uninterrupted one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from z2p_core.camera import Camera
from z2p_core.config.pipeline import TrainConfig, batch_size, training_fault
from z2p_core.images import bytes_from_unit
from z2p_core.interfaces import Condition, GBuffer, PointColors, ZBuffer
from z2p_core.linalg import dot_axis, rotate_points
from z2p_core.scene import SceneDescription
from z2p_core.shading.demodulation import radiance_factors
from z2p_renderer.pipeline.inference.input_buffers import draw_textured_buffers
from z2p_renderer.pipeline.training.augment import draw_training_cloud, mirror_record
from z2p_renderer.pipeline.training.distillation import Teacher
from z2p_renderer.pipeline.training.make_shard import downsample_images
from z2p_renderer.pipeline.training.shadow_debias import remove_shadow_bias
from z2p_renderer.pipeline.training.textured_samples import in_neutral_color, texture_albedo
from z2p_renderer.storage.shards import Record, Shard

RECORD_CACHE_BYTES = 2 * 1024**3
"""Memory for decoded renders; those that do not fit are decoded again each time."""
BUFFER_CACHE_BYTES = 6 * 1024**3
"""Memory for drawn buffers (`TrainConfig.reuse`); those that do not fit are drawn again, with the same result."""
PREFETCHED_BATCHES = 4
"""Batches made ahead of the training step."""
LOADER_THREADS = 2
"""Batches made at once; drawing buffers releases the interpreter's lock."""
TRAINING_SEED, VALIDATION_SEED, EPOCH_SEED, SPLIT_SEED = 0, 1, 2, 3
"""First words of the seeds of the random generators, one for each use, so that their streams differ."""


class DatasetError(ValueError):
    """Shards that cannot be trained on together; the message says which and why."""


@dataclass(frozen=True)
class Batch:
    """B samples, R pixels a side, C channels of z-buffer, G-buffer and conditions, S settings; float32 tensors."""

    buffers: torch.Tensor
    """(B, C, R, R)"""
    settings: torch.Tensor
    """(B, S), each in [0, 1]"""
    target: torch.Tensor
    """(B, 4, R, R) premultiplied sRGB and alpha"""
    coverage: torch.Tensor
    """(B, 1, R, R)"""
    factors: torch.Tensor | None = None
    """(B, 3, R, R), by which demodulation multiplies the network's image before it is compared with the target; None
    where no sample has a texture."""

    def to(self, device: torch.device) -> Batch:
        """The same batch on a device."""
        tensors = (self.buffers, self.settings, self.target, self.coverage, self.factors)
        return Batch(*(None if tensor is None else tensor.to(device) for tensor in tensors))  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Sample:
    """One cloud's buffers (C, R, R) float32, the record of its render, and the teacher's image of it."""

    buffers: np.ndarray
    record: Record
    """With a texture, its settings have the cloud's neutral color."""
    teacher_image: np.ndarray | None = None
    """(R, R, 4) uint8, premultiplied RGBA; None without a teacher."""
    factors: np.ndarray | None = None
    """(3, R, R) float16 or float32, see `Batch.factors`; None without a texture."""


@dataclass(frozen=True)
class _Drawing:
    """What is kept of a sample whose cloud is used again; the record itself is in a cache of its own."""

    number: int
    """Number of the cloud."""
    buffers: np.ndarray
    """(C, R, R) float16."""
    settings: np.ndarray
    teacher_image: np.ndarray | None
    factors: np.ndarray | None

    @property
    def nbytes(self) -> int:
        """Memory of its images, which do not change in size from one cloud to the next; textures' need it as well."""
        return self.buffers.nbytes + (0 if self.factors is None else self.factors.nbytes)


class CloudDataset:
    """All records of some shards, split into training and validation, as batches with random clouds."""

    def __init__(
        self,
        shards: Sequence[Path],
        config: TrainConfig,
        zbuffer: ZBuffer,
        gbuffer: GBuffer,
        conditions: Sequence[Condition] = (),
    ) -> None:
        """
        Raises:
            ShardError: a shard is damaged.
            DatasetError: no shards, shards of different controls or resolutions, or fewer than two records.
            WeightsError, TeacherError: the teacher's weights cannot be used.
        """
        self.config = config
        self.zbuffer, self.gbuffer, self.conditions = zbuffer, gbuffer, tuple(conditions)
        self.shards = [Shard(path) for path in shards]
        self.controls: list[dict[str, Any]] = _shared_attribute(self.shards, "controls")
        self.resolution: int = _shared_attribute(self.shards, "resolution")
        self.sides = config.resolutions or (self.resolution,)
        self.is_textured = bool(_shared_attribute(self.shards, "textured"))
        self.settings = sum(int(control["size"]) for control in self.controls)
        self._check()
        self._teacher = Teacher(config.teacher, self.resolution, self.controls) if config.teacher else None
        self._pools = [shard.pool for shard in self.shards]
        self._record_cache: dict[tuple[tuple[int, int], int], Record] = {}
        self._record_bytes_left, self._buffer_bytes_left = RECORD_CACHE_BYTES, BUFFER_CACHE_BYTES
        self._buffer_cache: dict[tuple[tuple[int, int], int], _Drawing] = {}
        places = [(number, row) for number, shard in enumerate(self.shards) for row in range(len(shard))]
        if len(places) < 2:
            raise DatasetError(f"expected two records or more, to train on and to validate with, got {len(places)}")
        order = np.random.default_rng((SPLIT_SEED, config.seed)).permutation(len(places))
        held_out = min(max(1, round(len(places) * config.validation_share)), len(places) - 1)
        self.validation = [places[place] for place in sorted(order[:held_out])]
        self.training = [places[place] for place in sorted(order[held_out:])]

    def batch(self, step: int) -> Batch:
        """Training batch number `step`, counted from 0; the sides alternate.

        At each side every record appears once per epoch, in a new order.
        """
        turn, number = divmod(step, len(self.sides))
        side, count = self.sides[number], len(self.training)
        size = batch_size(side, self.config.batch, self.sides)
        earlier = turn * self.sides.count(side) + self.sides[:number].count(side)  # batches at this side
        samples = []
        for position in range(earlier * size, (earlier + 1) * size):
            epoch, place = divmod(position, count)
            rng = np.random.default_rng((EPOCH_SEED, self.config.seed, self.sides.index(side), epoch))
            order = rng.permutation(count)
            samples.append(self._training_sample(int(order[place]), side, epoch // self.config.reuse))
        return _collate(samples, self.config.haze, self.config.teacher_share)

    def validation_batch(self, numbers: Sequence[int]) -> Batch:
        """Held-out samples `numbers` at the first side; each one's cloud depends on the seed and its number alone."""
        rngs = [np.random.default_rng((VALIDATION_SEED, self.config.seed, number)) for number in numbers]
        places = [self.validation[number] for number in numbers]
        samples = [self._sample(place, self.sides[0], rng) for place, rng in zip(places, rngs, strict=True)]
        return _collate(samples, self.config.haze)

    @contextmanager
    def batches(self, first: int, last: int) -> Iterator[Iterator[Batch]]:
        """Training batches `first` to `last` - 1, prefetched by threads that end with the context."""
        with ThreadPoolExecutor(max_workers=LOADER_THREADS, thread_name_prefix="batches") as executor:

            def prefetched() -> Iterator[Batch]:
                begun = min(first + PREFETCHED_BATCHES, last)
                pending = [executor.submit(self.batch, step) for step in range(first, begun)]
                for step in range(first, last):
                    yield pending.pop(0).result()
                    if step + PREFETCHED_BATCHES < last:
                        pending.append(executor.submit(self.batch, step + PREFETCHED_BATCHES))

            try:
                yield prefetched()
            finally:
                executor.shutdown(wait=True, cancel_futures=True)

    @property
    def fixed_elevation(self) -> float | None:
        """The camera elevation of every record in degrees; None where it is one of the controls.

        Raises:
            DatasetError: elevation is no control, but differs between the records.
        """
        if any(control["name"] == "elevation" for control in self.controls):
            return None
        values = np.concatenate([shard.elevations for shard in self.shards])
        if np.ptp(values) > 1e-3:
            raise DatasetError(
                f"renders lie between {values.min():g} and {values.max():g} degrees of camera elevation; expected one "
                "elevation, or elevation among the controls"
            )
        return float(values[0])

    def _check(self) -> None:
        if fault := training_fault(self.config, self.resolution):
            raise DatasetError(fault)
        if (self.is_textured or self.conditions) and not self.gbuffer.draws_textures:
            raise DatasetError(f"textures and conditions need a G-buffer that draws textures, got {self.gbuffer.name}")
        if (self.is_textured or self.conditions) and "color" not in [control["name"] for control in self.controls]:
            raise DatasetError("textures and conditions need the control color, got shards without it")
        if self.is_textured and self.config.teacher:
            raise DatasetError("teacher: expected none for shards with textures, which teachers do not draw")

    def _training_sample(self, number: int, side: int, drawing: int) -> _Sample:
        """Sample of a training record with cloud number `drawing`, whose buffers are cached until the next one."""
        place = self.training[number]
        cached = self._buffer_cache.get((place, side))
        rng = np.random.default_rng((TRAINING_SEED, self.config.seed, side, number, drawing))
        is_mirrored = self.config.mirror and bool(rng.integers(2))
        if cached and cached.number == drawing:
            record = replace(self._record(place, side, is_mirrored), settings=cached.settings)
            return _Sample(cached.buffers.astype(np.float32), record, cached.teacher_image, cached.factors)
        # at the shards' own resolution a teacher has no advantage
        sample = self._sample(place, side, rng, is_mirrored, self._teacher if side < self.resolution else None)
        if self.config.reuse > 1:
            packed = sample.buffers.astype(np.float16)
            factors = None if sample.factors is None else sample.factors.astype(np.float16)
            kept = _Drawing(drawing, packed, sample.record.settings, sample.teacher_image, factors)
            if cached or kept.nbytes <= self._buffer_bytes_left:
                self._buffer_bytes_left -= 0 if cached else kept.nbytes
                self._buffer_cache[place, side] = kept
            # rounded whether it was cached or not
            sample = replace(sample, buffers=packed.astype(np.float32), factors=factors)
        return sample

    def _sample(
        self,
        place: tuple[int, int],
        side: int,
        rng: np.random.Generator,
        is_mirrored: bool = False,
        teacher: Teacher | None = None,
    ) -> _Sample:
        record, pool = self._record(place, side, is_mirrored), self._pools[place[0]]
        rotation = np.array(record.scene.rotation, dtype=np.float32)
        cloud = draw_training_cloud(pool, self.config, rng)
        albedo = texture_albedo(record, cloud)
        if albedo is not None:
            record = in_neutral_color(record, albedo, self.controls)
        scene = record.scene
        if scene.floor is None:  # the mesh's lowest point; the pool is dense enough to give it
            scene = replace(scene, floor=float(dot_axis(pool, rotation[2]).min()))
        cloud = rotate_points(cloud, rotation)
        cloud[:, 2] += scene.lift
        if is_mirrored:
            cloud[:, 0] *= -1
        colors, camera = None if albedo is None else PointColors(cloud, albedo), Camera(side, side, scene.elevation)
        buffers, relative = draw_textured_buffers(
            cloud, colors, camera, scene, self.zbuffer, self.gbuffer, self.conditions
        )
        taught = self._teacher_image(teacher, cloud, scene, record, side) if teacher else None
        factors = None if colors is None or relative is None else radiance_factors(relative)
        return _Sample(buffers, record, taught, factors)

    def _teacher_image(
        self, teacher: Teacher, cloud: np.ndarray, scene: SceneDescription, record: Record, side: int
    ) -> np.ndarray:
        """The teacher's image (side, side, 4) uint8; with `TrainConfig.mirror` the mean with its mirrored image."""
        image = teacher.picture(cloud, scene, record.settings, side)
        if self.config.mirror:
            mirrored = mirror_record(record)
            mirrored_scene = replace(mirrored.scene, floor=scene.floor)
            mirrored_cloud = cloud * np.array([-1, 1, 1], np.float32)
            other = teacher.picture(mirrored_cloud, mirrored_scene, mirrored.settings, side)
            image = (image + other[:, ::-1]) / 2
        return bytes_from_unit(image)

    def _record(self, place: tuple[int, int], side: int, is_mirrored: bool = False) -> Record:
        record = self._record_cache.get((place, side))
        if record is None:
            record = self.shards[place[0]].read(place[1])
            rgba, coverage = downsample_images(record.rgba, record.coverage, self.resolution // side)
            record = replace(record, rgba=rgba, coverage=coverage)
            size = record.rgba.nbytes + record.coverage.nbytes
            if size <= self._record_bytes_left:
                self._record_bytes_left -= size
                self._record_cache[place, side] = record
        return mirror_record(record) if is_mirrored else record


def _collate(samples: list[_Sample], haze: float, teacher_share: float = 0.0) -> Batch:
    """Batch of samples. Targets are renders without shadow bias `haze`, blended on the object with the teacher's."""
    records = [sample.record for sample in samples]
    rgba = _float_images([record.rgba for record in records])
    coverage = torch.from_numpy(np.stack([record.coverage for record in records])).float()[:, None] / 255
    target = remove_shadow_bias(torch.cat([rgba[:, :3] * rgba[:, 3:], rgba[:, 3:]], dim=1), coverage, haze)
    taught_images = [sample.teacher_image for sample in samples if sample.teacher_image is not None]
    if taught_images:  # all samples of a batch have one or none; not on the floor: a teacher's shadows may be biased
        target = torch.lerp(target, _float_images(taught_images), teacher_share * (coverage > 0))
    settings = torch.from_numpy(np.stack([record.settings for record in records]))
    buffers = torch.from_numpy(np.stack([sample.buffers for sample in samples]))
    return Batch(buffers, settings, target, coverage, _factors(samples))


def _factors(samples: list[_Sample]) -> torch.Tensor | None:
    """`Batch.factors` of samples: 1 for those without a texture."""
    if all(sample.factors is None for sample in samples):
        return None
    one = np.ones((3, *samples[0].buffers.shape[1:]), np.float32)
    return torch.from_numpy(np.stack([one if sample.factors is None else sample.factors for sample in samples])).float()


def _float_images(images: list[np.ndarray]) -> torch.Tensor:
    """Values (B, 4, R, R) float32 in [0, 1] of images (R, R, 4) uint8."""
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255


def _shared_attribute(shards: list[Shard], key: str) -> Any:
    """The value of attribute `key`, which all shards must share."""
    if not shards:
        raise DatasetError("expected shards to train on, got none")
    first = shards[0].attributes.get(key)
    for shard in shards[1:]:
        if (other := shard.attributes.get(key)) != first:
            raise DatasetError(
                f"shards differ in {key}: {shards[0].path} has {first}, {shard.path} has {other}; make them with one "
                "config"
            )
    return first
