"""Table 1, what each method can do: every tick of a method that runs here is a figure held against a bound."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from z2p_renderer.pipeline.evaluation.paper.page.results import Findings, mean

QUOTED: dict[str, dict[str, str]] = {
    "Ray tracing": dict(raw="no", normals="-", unseen="yes", inner="-", points="-", shadows="yes", colors="-",
                        scenes="-"),
    "Neural point rendering": dict(raw="no", normals="yes", unseen="no", inner="yes", points="no", shadows="-",
                                   colors="yes", scenes="yes"),
    "Point2Mesh": dict(raw="yes", normals="yes", unseen="yes", inner="?", points="?", shadows="yes", colors="?",
                       scenes="?"),
    "DSS (splatting)": dict(raw="yes", normals="yes / no", unseen="yes", inner="yes", points="no", shadows="no",
                            colors="yes", scenes="yes"),
}  # fmt: skip
"""What does not run here: the paper's Table 1; of Point2Mesh what its text says, ? where it says nothing."""
PAPER_WORD: dict[str, tuple[str, ...]] = {
    "raw": ("yes", "yes", "yes", "yes"), "normals": ("yes / no", "yes", "no", "yes"),
    "unseen": ("yes", "yes", "yes", "yes"), "inner": ("yes", "yes", "no", "yes"),
    "points": ("no", "yes", "no", "yes"), "shadows": ("no", "no", "yes", "yes"),
    "colors": ("yes", "yes", "yes", "no"), "scenes": ("yes", "yes", "yes", "no"),
}  # fmt: skip
"""The paper's word on splatting, screen space, reconstruction, and Z2P."""
FAMILY_OF = {"splats": 0, "balls": 0, "screen": 1, "hpr": 2, "bpa": 2, "poisson": 2}


@dataclass(frozen=True)
class Verdict:
    """`passed` is None where nothing was measured; `why` gives the figure and the bound."""

    passed: bool | None
    why: str
    paper: str = ""


@dataclass(frozen=True)
class Ability:
    """A row of the table, and how it is tested."""

    key: str
    title: str
    test: str


ABILITIES = (
    Ability("raw", "Raw xyz points", "every plain cloud, given as bare xyz, gives a picture"),
    Ability("normals", "Handles points without normals", "no step of it solves for oriented normals"),
    Ability("unseen", "Generalizes to unseen objects", "object PSNR of the plain case is 18 dB or more on every mesh"),
    Ability("inner", "Robust to internal points", "most inner points cost 0.05 of SSIM or less; object PSNR does not "
            "see matter beside the object"),
    Ability("points", "Robust to number of points", "object PSNR at 1,000 to 20,000 points stays within 4 dB"),
    Ability("shadows", "Shadows", "half of the floor's true shadow or more is there in the plain case"),
    Ability("colors", "Per point colors", "it takes a colour for each point"),
    Ability("scenes", "Scene level scans", "most objects on one floor cost 3 dB of object PSNR or less against one"),
)
UNSEEN, INNER_LOSS, POINTS_SPREAD, SHADOW, SCENE_LOSS = 18.0, 0.05, 4.0, 0.5, 3.0
COUNTS = (1_000, 20_000)


def verdicts(findings: Findings, method: str, is_weights: bool) -> dict[str, Verdict]:
    """Verdict on each ability of a method that ran."""
    family = 3 if is_weights else FAMILY_OF.get(method)
    tests: Mapping[str, Callable[[Findings, str, bool], Verdict]] = {
        "raw": _raw, "normals": _normals, "unseen": _unseen, "inner": _inner, "points": _points, "shadows": _shadows,
        "colors": _colors, "scenes": _scenes,
    }  # fmt: skip
    found = {}
    for key, test in tests.items():
        verdict = test(findings, method, is_weights)
        found[key] = Verdict(verdict.passed, verdict.why, "" if family is None else PAPER_WORD[key][family])
    return found


def _raw(findings: Findings, method: str, is_weights: bool) -> Verdict:
    rows = findings.rows("base", method)
    drawn = sum("error" not in row for row in rows)
    return Verdict(drawn == len(rows) if rows else None, f"{drawn} of {len(rows)} clouds")


def _normals(findings: Findings, method: str, is_weights: bool) -> Verdict:
    rows = findings.rows("base", method)
    if not rows:
        return Verdict(None, "not measured")
    needs = any("normals" in row.get("steps", {}) for row in rows)
    planes = is_weights or any("planes" in row.get("steps", {}) for row in rows)
    inside = "; planes through neighbours, not oriented" if planes and not needs else ""
    return Verdict(not needs, ("a step of it orients normals" if needs else "no such step") + inside)


def _unseen(findings: Findings, method: str, is_weights: bool) -> Verdict:
    by_mesh = findings.by_mesh("base", method, "psnr_foreground")
    if not by_mesh:
        return Verdict(None, "not measured")
    worst = min(by_mesh, key=lambda mesh: by_mesh[mesh])
    return Verdict(by_mesh[worst] >= UNSEEN, f"worst {by_mesh[worst]:.1f} dB ({worst})")


def _inner(findings: Findings, method: str, is_weights: bool) -> Verdict:
    loss = _loss(findings, "inner", method, "ssim")
    return Verdict(None, "not measured") if loss is None else Verdict(loss <= INNER_LOSS, _lost(loss, "{:.3f}"))


def _points(findings: Findings, method: str, is_weights: bool) -> Verdict:
    levels = {level: value for level, value in findings.curve("density", method, "psnr_foreground")
              if COUNTS[0] <= float(level) <= COUNTS[1]}  # fmt: skip
    if len(levels) < 2:
        return Verdict(None, "not measured")
    spread = max(levels.values()) - min(levels.values())
    return Verdict(spread <= POINTS_SPREAD, f"{spread:.1f} dB over {len(levels)} densities")


def _shadows(findings: Findings, method: str, is_weights: bool) -> Verdict:
    kept = mean(findings.values("base", method, "shadow_kept"))
    return Verdict(None, "not measured") if kept is None else Verdict(kept >= SHADOW, f"{kept:.0%} of the shadow")


def _colors(findings: Findings, method: str, is_weights: bool) -> Verdict:
    return Verdict(False, "takes xyz alone here")


def _scenes(findings: Findings, method: str, is_weights: bool) -> Verdict:
    loss = _loss(findings, "scene", method, "psnr_foreground")
    return Verdict(None, "not measured") if loss is None else Verdict(loss <= SCENE_LOSS, _lost(loss, "{:.1f} dB"))


def _loss(findings: Findings, sweep: str, method: str, figure: str) -> float | None:
    """What the last level of a sweep costs of a figure against the first."""
    curve: Sequence[tuple[str, float]] = findings.curve(sweep, method, figure)
    return curve[0][1] - curve[-1][1] if len(curve) > 1 else None


def _lost(loss: float, form: str) -> str:
    return ("loses " if loss >= 0 else "gains ") + form.format(abs(loss))
