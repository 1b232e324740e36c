"""The paper's Table 1, capabilities of each method: every entry of a method that runs here is a measured metric
against a bound."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from z2p_renderer.pipeline.evaluation.paper.page.results import CONTRAST_KEPT, Results, mean

QUOTED_METHODS: dict[str, dict[str, str]] = {
    "Ray tracing": dict(raw="no", normals="-", unseen="yes", inner="-", points="-", shadows="yes", colors="-",
                        scenes="-"),
    "Neural point rendering": dict(raw="no", normals="yes", unseen="no", inner="yes", points="no", shadows="-",
                                   colors="yes", scenes="yes"),
    "Point2Mesh": dict(raw="yes", normals="yes", unseen="yes", inner="?", points="?", shadows="yes", colors="?",
                       scenes="?"),
    "DSS (splatting)": dict(raw="yes", normals="yes / no", unseen="yes", inner="yes", points="no", shadows="no",
                            colors="yes", scenes="yes"),
}  # fmt: skip
"""Methods that do not run here, quoted from the paper's Table 1 (Point2Mesh: from its text; ? where it is silent)."""
PAPER_ANSWERS: dict[str, tuple[str, ...]] = {
    "raw": ("yes", "yes", "yes", "yes"), "normals": ("yes / no", "yes", "no", "yes"),
    "unseen": ("yes", "yes", "yes", "yes"), "inner": ("yes", "yes", "no", "yes"),
    "points": ("no", "yes", "no", "yes"), "shadows": ("no", "no", "yes", "yes"),
    "colors": ("yes", "yes", "yes", "no"), "scenes": ("yes", "yes", "yes", "no"),
}  # fmt: skip
"""Capability -> the paper's answer for splatting, screen space, reconstruction and Z2P."""
PAPER_FAMILY = {"splats": 0, "balls": 0, "screen": 1, "hpr": 2, "bpa": 2, "poisson": 2}
"""Baseline -> its column in `PAPER_ANSWERS`."""


@dataclass(frozen=True)
class CapabilityVerdict:
    """`passed` is None if nothing was measured; `why` gives the measured value; `paper` the paper's answer."""

    passed: bool | None
    why: str
    paper: str = ""


@dataclass(frozen=True)
class Capability:
    """A row of the table, and its test in words."""

    key: str
    title: str
    test: str


CAPABILITIES = (
    Capability("raw", "Raw xyz points", "every plain cloud, given as bare xyz, gives a picture"),
    Capability("normals", "Handles points without normals", "no step of it solves for oriented normals"),
    Capability(
        "unseen", "Generalizes to unseen objects", "object PSNR of the plain case is 18 dB or more on every mesh"
    ),
    Capability(
        "inner",
        "Robust to internal points",
        "most inner points cost 0.05 of SSIM or less; object PSNR does not see matter beside the object",
    ),
    Capability("points", "Robust to number of points", "object PSNR at 1,000 to 20,000 points stays within 4 dB"),
    Capability("shadows", "Shadows", "half of the floor's true shadow or more is there in the plain case"),
    Capability(
        "colors",
        "Per point colors",
        "half or more of the change is there that textures make in the true picture, their colours given at the points",
    ),
    Capability("scenes", "Scene level scans", "most objects on one floor cost 3 dB of object PSNR or less against one"),
)
MIN_UNSEEN_PSNR = 18.0
"""dB on the object, plain case, every mesh."""
MAX_INNER_SSIM_LOSS = 0.05
MAX_DENSITY_PSNR_RANGE = 4.0
"""dB on the object between the densities of `DENSITY_RANGE`."""
MIN_SHADOW_SHARE = 0.5
MIN_TEXTURE_CONTRAST = 0.5
"""Share of the difference between a textured picture and that in one color."""
MAX_SCENE_PSNR_LOSS = 3.0
"""dB on the object, most objects against one."""
DENSITY_RANGE = (1_000, 20_000)
"""Fewest and most points of the density test."""


def assess_capabilities(results: Results, method: str, is_weights: bool) -> dict[str, CapabilityVerdict]:
    """Verdict on each capability of a method that ran."""
    family = 3 if is_weights else PAPER_FAMILY.get(method)
    tests: Mapping[str, Callable[[Results, str, bool], CapabilityVerdict]] = {
        "raw": _raw, "normals": _normals, "unseen": _unseen, "inner": _inner, "points": _points, "shadows": _shadows,
        "colors": _colors, "scenes": _scenes,
    }  # fmt: skip
    verdicts = {}
    for key, test in tests.items():
        verdict = test(results, method, is_weights)
        verdicts[key] = CapabilityVerdict(
            verdict.passed, verdict.why, "" if family is None else PAPER_ANSWERS[key][family]
        )
    return verdicts


def _raw(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    rows = results.rows("base", method)
    drawn = sum("error" not in row for row in rows)
    return CapabilityVerdict(drawn == len(rows) if rows else None, f"{drawn} of {len(rows)} clouds")


def _normals(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    rows = results.rows("base", method)
    if not rows:
        return CapabilityVerdict(None, "not measured")
    needs = any("normals" in row.get("steps", {}) for row in rows)
    planes = is_weights or any("planes" in row.get("steps", {}) for row in rows)
    inside = "; planes through neighbours, not oriented" if planes and not needs else ""
    return CapabilityVerdict(not needs, ("a step of it orients normals" if needs else "no such step") + inside)


def _unseen(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    by_mesh = results.by_mesh("base", method, "psnr_foreground")
    if not by_mesh:
        return CapabilityVerdict(None, "not measured")
    worst = min(by_mesh, key=lambda mesh: by_mesh[mesh])
    return CapabilityVerdict(by_mesh[worst] >= MIN_UNSEEN_PSNR, f"worst {by_mesh[worst]:.1f} dB ({worst})")


def _inner(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    loss = _loss_over_sweep(results, "inner", method, "ssim")
    return (
        CapabilityVerdict(None, "not measured")
        if loss is None
        else CapabilityVerdict(loss <= MAX_INNER_SSIM_LOSS, _describe_loss(loss, "{:.3f}"))
    )


def _points(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    levels = {level: value for level, value in results.curve("density", method, "psnr_foreground")
              if DENSITY_RANGE[0] <= float(level) <= DENSITY_RANGE[1]}  # fmt: skip
    if len(levels) < 2:
        return CapabilityVerdict(None, "not measured")
    spread = max(levels.values()) - min(levels.values())
    return CapabilityVerdict(spread <= MAX_DENSITY_PSNR_RANGE, f"{spread:.1f} dB over {len(levels)} densities")


def _shadows(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    kept = mean(results.values("base", method, "shadow_kept"))
    return (
        CapabilityVerdict(None, "not measured")
        if kept is None
        else CapabilityVerdict(kept >= MIN_SHADOW_SHARE, f"{kept:.0%} of the shadow")
    )


def _colors(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    kept = mean(results.values("texture", method, CONTRAST_KEPT))
    if kept is not None:
        return CapabilityVerdict(kept >= MIN_TEXTURE_CONTRAST, f"{kept:.0%} of the textures")
    errors = [row["error"] for row in results.rows("texture", method) if "error" in row]
    return CapabilityVerdict(False, errors[0]) if errors else CapabilityVerdict(None, "not measured")


def _scenes(results: Results, method: str, is_weights: bool) -> CapabilityVerdict:
    loss = _loss_over_sweep(results, "scene", method, "psnr_foreground")
    return (
        CapabilityVerdict(None, "not measured")
        if loss is None
        else CapabilityVerdict(loss <= MAX_SCENE_PSNR_LOSS, _describe_loss(loss, "{:.1f} dB"))
    )


def _loss_over_sweep(results: Results, sweep: str, method: str, figure: str) -> float | None:
    """Decrease of a metric from the first to the last level of a sweep."""
    curve: Sequence[tuple[str, float]] = results.curve(sweep, method, figure)
    return curve[0][1] - curve[-1][1] if len(curve) > 1 else None


def _describe_loss(loss: float, form: str) -> str:
    return ("loses " if loss >= 0 else "gains ") + form.format(abs(loss))
