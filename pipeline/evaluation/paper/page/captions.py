"""The report's words on each sweep; they affect no number."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SweepCaption:
    """Title of a sweep, label of its axis, and what it shows."""

    title: str
    axis: str
    description: str
    paper_reference: str = ""
    """Figure or section of the paper that shows the same."""
    is_log_scale: bool = False
    """Whether the axis is logarithmic."""


SWEEP_CAPTIONS: dict[str, SweepCaption] = {
    "base": SweepCaption("Every method, plain case", "", "Uniform samples without noise."),
    "noise": SweepCaption(
        "Noise", "standard deviation, radii", "Gaussian noise on every point.", "handling noisy inputs"
    ),
    "density": SweepCaption("Density", "points", "More and fewer points.", "density and ablation", is_log_scale=True),
    "sampling": SweepCaption(
        "Sampling",
        "",
        "Ways of drawing the same number of points; non-uniform is ten times as dense on one side.",
        "robustness to sampling",
    ),
    "inner": SweepCaption(
        "Inner points",
        "share of the points",
        "Points inside the object, as generative networks leave them.",
        "generated clouds",
    ),
    "scale": SweepCaption(
        "Scale", "share of the frame", "The object at other sizes in the frame.", "supplementary: scale"
    ),
    "single": SweepCaption(
        "Single view", "", "What one simulated depth camera 40 degrees to the side sees.", "single-view scans"
    ),
    "lift": SweepCaption(
        "Lifted object",
        "radii above the floor",
        "The object hovers; the shadow must stay on the floor.",
        "positional encoding",
    ),
    "light": SweepCaption("Light around", "azimuth, degrees", "The light goes around the object.", "light control"),
    "color": SweepCaption("Colours", "", "The same view in other colours.", "colour control"),
    "turning": SweepCaption("Turning views", "degrees", "The object turns about its upright axis.", "turning views"),
    "material": SweepCaption("Metallic and roughness", "", "Levels are metallic, roughness.", "material control"),
    "texture": SweepCaption(
        "Textures",
        "",
        "The object in colours that vary from place to place; each method gets that of every point. Contrast kept is 1 "
        "where all of the true picture's change from one colour is there, 0 where none.",
        "Table 1, colours of points",
    ),
    "sheet": SweepCaption("Thin sheets", "thickness, radii", "A wavy sheet, open at thickness 0.", "sheets"),
    "scene": SweepCaption("Scenes", "objects", "Several objects on one floor.", "Table 1, scenes"),
    "bumps": SweepCaption(
        "Limit: fine detail",
        "degree of the harmonic",
        "A ball with bumps of rising frequency and equal "
        "steepness; contrast kept is 1 where all of the true picture's change is there, 0 where none.",
        "supplementary: spherical harmonics",
        is_log_scale=True,
    ),
    "gap": SweepCaption(
        "Limit: near surfaces",
        "distance, radii",
        "Two plates that near each other; contrast kept is 1 where "
        "the gap is as in the true picture, 0 where they are one block.",
        "limitation",
        is_log_scale=True,
    ),
}
