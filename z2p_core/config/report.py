"""What the report on the paper's evaluation holds; TOML files such as ``configs/report.toml`` override the defaults."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from z2p_core.config.pipeline import ConfigError, from_dict, toml_tables
from z2p_core.config.pipeline_limits import check_limits
from z2p_core.config.report_limits import REPORT


@dataclass(frozen=True)
class NumberSweep:
    """One thing varied over numbers; no levels leave the sweep out."""

    levels: tuple[float, ...] = ()
    meshes: int = 0
    """How many of the meshes take part, the first by name; 0 for all. Sweeps over shapes of their own ignore it."""


@dataclass(frozen=True)
class NameSweep:
    """The same over things that have names."""

    levels: tuple[str, ...] = ()
    meshes: int = 0


Sweep = NumberSweep | NameSweep


@dataclass(frozen=True)
class ReportConfig:
    """The whole report: which meshes, which methods, which sweeps. `pipeline.evaluation.paper.cases.sweeps` tells what each varies."""

    name: str = "paper-report"
    meshes: str = "builtin"
    """A folder of meshes never trained on, or ``builtin`` for the project's own that are kept aside."""
    scans: str = ""
    """A folder of scans to show beside the baselines, without numbers; empty for none."""
    weights: tuple[str, ...] = ()
    """Shipped names or files; empty for all that are shipped."""
    baselines: tuple[str, ...] = ("bpa", "poisson", "hpr", "splats", "balls", "screen")
    views: int = 1
    """Views of each mesh."""
    points: int = 5_000
    """Points in a cloud, where they are not what is varied."""
    resolution: int = 256
    samples: int = 16
    denoise: str = "high"
    seed: int = 0
    time_repeats: int = 3
    """How often each time of Tables 2 and 3 is taken; the median counts."""
    trust_draws: int = 8
    """Resampled pictures that a map of disagreement is made of; 0 leaves that section out."""
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
    sheet: NumberSweep = NumberSweep((0.0, 0.01, 0.03, 0.1))
    scene: NumberSweep = NumberSweep((1.0, 4.0, 9.0))
    bumps: NumberSweep = NumberSweep((4.0, 8.0, 16.0, 32.0, 64.0))
    gap: NumberSweep = NumberSweep((0.4, 0.2, 0.1, 0.05, 0.025))

    def sweeps(self) -> dict[str, Sweep]:
        """The sweeps that have levels, by name, in the report's order."""
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: one for name, one in found.items() if isinstance(one, NumberSweep | NameSweep) and one.levels}


SWEEP_NAMES = tuple(one.name for one in fields(ReportConfig) if one.type in ("NumberSweep", "NameSweep"))


def parse_report(text: str, source: str = "config") -> ReportConfig:
    """ReportConfig of a TOML text; what it leaves out keeps the defaults.

    Raises:
        ConfigError: not TOML, an unknown key, a value of the wrong type, or one that cannot be.
    """
    data = toml_tables(text, source)
    return check_report(from_dict(ReportConfig, data, source), source)


def check_report(config: Any, source: str = "config") -> ReportConfig:
    """The config itself, when its values can be.

    Raises:
        ConfigError: one cannot; the message names it.
    """
    check_limits(config, REPORT, f"{source}: ")
    if config.trust_draws == 1:
        raise ConfigError(f"{source}: trust_draws: expected 0, or 2 or more, got {config.trust_draws}")
    if not config.base.levels:
        raise ConfigError(f"{source}: base: expected levels = [0], as every table starts there")
    return config
