"""The configuration of the report on the paper; TOML files such as ``configs/report.toml`` override the defaults."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from z2p_core.config.pipeline import ConfigError, from_dict, toml_tables
from z2p_core.config.pipeline_limits import check_limits
from z2p_core.config.report_limits import REPORT


@dataclass(frozen=True)
class NumberSweep:
    """A parameter varied over numbers; without levels the sweep is left out."""

    levels: tuple[float, ...] = ()
    meshes: int = 0
    """Number of meshes, the first by name; 0 for all. Sweeps over synthetic shapes ignore it."""


@dataclass(frozen=True)
class NameSweep:
    """A parameter varied over names; without levels the sweep is left out."""

    levels: tuple[str, ...] = ()
    meshes: int = 0


Sweep = NumberSweep | NameSweep


@dataclass(frozen=True)
class ReportConfig:
    """The report: its meshes, methods and sweeps. `pipeline.evaluation.paper.cases.sweeps` defines what each varies."""

    name: str = "paper-report"
    meshes: str = "builtin"
    """A folder of meshes not used in training, or ``builtin`` for the built-in validation shapes."""
    scans: str = ""
    """A folder of scans that all methods draw, without metrics; empty for none."""
    weights: tuple[str, ...] = ()
    """Shipped names or files; empty for all shipped ones."""
    baselines: tuple[str, ...] = ("bpa", "poisson", "hpr", "splats", "balls", "screen")
    views: int = 1
    """Views of each mesh."""
    points: int = 5_000
    """Points of a cloud, except in the sweep over densities."""
    resolution: int = 256
    samples: int = 16
    denoise: str = "high"
    seed: int = 0
    time_repeats: int = 3
    """Repeats of each time of Tables 2 and 3, of which the median is reported."""
    trust_draws: int = 8
    """Pictures of random half clouds per disagreement map; 0 leaves the section out."""
    trust_meshes: int = 0
    base: NumberSweep = NumberSweep((0.0,))
    noise: NumberSweep = NumberSweep((0.0, 0.001, 0.005, 0.01, 0.02, 0.03))
    density: NumberSweep = NumberSweep((1_000.0, 2_000.0, 5_000.0, 10_000.0, 20_000.0, 100_000.0))
    sampling: NameSweep = NameSweep(("grid", "farthest", "poisson_disk", "uniform", "non-uniform"), 3)
    inner: NumberSweep = NumberSweep((0.0, 0.1, 0.3), 3)
    scale: NumberSweep = NumberSweep((0.4, 0.7, 1.0), 2)
    single: NameSweep = NameSweep(("clean", "noise", "holes"), 2)
    lift: NumberSweep = NumberSweep((0.0, 0.1, 0.2, 0.4), 2)
    light: NumberSweep = NumberSweep((-80.0, -40.0, 0.0, 40.0, 80.0), 2)
    color: NameSweep = NameSweep(("#c0392b", "#e0b020", "#2e8b57", "#2c5fa8", "#404040"), 1)
    turning: NumberSweep = NumberSweep((0.0, 30.0, 60.0, 90.0, 120.0), 1)
    material: NameSweep = NameSweep(("0,0.9", "0,0.3", "1,0.6", "1,0.3"), 1)
    texture: NameSweep = NameSweep(("none", "smooth", "stripes", "spots"), 3)
    sheet: NumberSweep = NumberSweep((0.0, 0.01, 0.03, 0.1))
    scene: NumberSweep = NumberSweep((1.0, 4.0, 9.0))
    bumps: NumberSweep = NumberSweep((4.0, 8.0, 16.0, 32.0, 64.0))
    gap: NumberSweep = NumberSweep((0.4, 0.2, 0.1, 0.05, 0.025))

    def sweeps(self) -> dict[str, Sweep]:
        """The sweeps that have levels, by name, in the report's order."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: one for name, one in values.items() if isinstance(one, NumberSweep | NameSweep) and one.levels}


SWEEP_NAMES = tuple(one.name for one in fields(ReportConfig) if one.type in ("NumberSweep", "NameSweep"))


def parse_report(text: str, source: str = "config") -> ReportConfig:
    """ReportConfig of a TOML text; missing keys keep their defaults.

    Raises:
        ConfigError: not TOML, an unknown key, a value of the wrong type, or one out of its limits.
    """
    data = toml_tables(text, source)
    return check_report(from_dict(ReportConfig, data, source), source)


def check_report(config: Any, source: str = "config") -> ReportConfig:
    """The config itself, after checking its values.

    Raises:
        ConfigError: a value is out of its limits; the message names it.
    """
    check_limits(config, REPORT, f"{source}: ")
    if config.trust_draws == 1:
        raise ConfigError(f"{source}: trust_draws: expected 0, or 2 or more, got {config.trust_draws}")
    if not config.base.levels:
        raise ConfigError(f"{source}: base: expected levels = [0], as every table starts there")
    return config
