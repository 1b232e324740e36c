"""Six metrics of a picture against Blender's render.

=================  =============================================================================================
`psnr_white`       PSNR (dB) on white, whole picture, so the shadow counts
`psnr_foreground`  PSNR (dB) on white, pixels that the object covers by more than 0.9
`ssim`             structural similarity of RGB on white (window 11, sigma 1.5), mean over the object's box
`flip`             FLIP on white at 67 pixels a degree, mean over the object's box; less is better
`alpha_l1`         mean |alpha difference|, whole picture
`shadow_l1`        mean |alpha difference| where the object covers nothing
=================  =============================================================================================

The box is the object's bounding box (coverage above 0) grown by 8 pixels and cut at the picture's edge; the maps of
SSIM and FLIP are computed on the whole picture and averaged in it. Coverage comes from a pass without shadow.
"""

from __future__ import annotations

import numpy as np

from z2p_core.images import composite

METRIC_NAMES = ("psnr_white", "psnr_foreground", "ssim", "flip", "alpha_l1", "shadow_l1")
FOREGROUND_COVERAGE = 0.9
"""Coverage above which a pixel belongs to the object."""
BOX_MARGIN_PIXELS = 8
"""Margin around the object's bounding box in which SSIM and FLIP are averaged."""
PSNR_CAP = 100.0
"""PSNR of identical images, dB."""
SSIM_WINDOW = 11
"""Side of the Gaussian window of structural similarity, pixels; its sigma is 1.5."""
PIXELS_PER_DEGREE = 67.0
"""Viewing condition of FLIP: its default, a 4k monitor at 0.7 m."""
WHITE = (1.0, 1.0, 1.0)


def image_metrics(prediction: np.ndarray, truth: np.ndarray, coverage: np.ndarray) -> dict[str, float]:
    """The six metrics by `METRIC_NAMES`; nan for one without pixels (a thin thread covers none by 0.9).

    `prediction` and `truth` (H, W, 4) are straight sRGB RGBA, `coverage` (H, W) the object's share of each pixel of
    `truth`; all float in [0, 1].

    Raises:
        ValueError: shapes that do not match, values outside [0, 1], an image too small, or no object in it.
    """
    _check(prediction, truth, coverage)
    prediction, truth = prediction.astype(np.float32), truth.astype(np.float32)
    ours, theirs = composite(prediction, WHITE), composite(truth, WHITE)
    alpha_error = np.abs(prediction[..., 3] - truth[..., 3])
    box = object_box(coverage)
    return {
        "psnr_white": psnr(ours, theirs),
        "psnr_foreground": psnr(ours[coverage > FOREGROUND_COVERAGE], theirs[coverage > FOREGROUND_COVERAGE]),
        "ssim": float(ssim_map(ours, theirs)[box].mean()),
        "flip": float(flip_map(ours, theirs)[box].mean()),
        "alpha_l1": _mean(alpha_error),
        "shadow_l1": _mean(alpha_error[coverage == 0]),
    }


def object_box(coverage: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the object's bounding box grown by `BOX_MARGIN_PIXELS`, cut at the edge of coverage (H, W).

    Raises:
        ValueError: no pixel is covered.
    """
    rows, columns = np.nonzero(coverage > 0)
    if len(rows) == 0:
        raise ValueError("coverage: expected an object in the picture, got 0 everywhere; is the mesh out of the frame?")
    return (
        slice(max(0, int(rows.min()) - BOX_MARGIN_PIXELS), int(rows.max()) + 1 + BOX_MARGIN_PIXELS),
        slice(max(0, int(columns.min()) - BOX_MARGIN_PIXELS), int(columns.max()) + 1 + BOX_MARGIN_PIXELS),
    )


def psnr(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Peak signal-to-noise ratio in dB of values in [0, 1], at most `PSNR_CAP`; nan without values."""
    error = _mean((ours.astype(np.float64) - theirs) ** 2)
    if np.isnan(error):
        return error
    return PSNR_CAP if error == 0 else min(PSNR_CAP, -10 * float(np.log10(error)))


def ssim_map(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Structural similarity (H, W, 3) of RGB pictures (H, W, 3) in [0, 1] (Wang et al. 2004), channel by channel."""
    import torch  # late, as kornia: both are slow to import
    from kornia.metrics import ssim  # its Gaussian has sigma 1.5

    first, second = (torch.from_numpy(picture.astype(np.float64)).permute(2, 0, 1)[None] for picture in (ours, theirs))
    similarity: np.ndarray = ssim(first, second, SSIM_WINDOW)[0].permute(1, 2, 0).numpy()
    return similarity


def flip_map(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """FLIP error (H, W) in [0, 1] between sRGB pictures (H, W, 3) in [0, 1] (Andersson et al. 2020)."""
    import flip_evaluator  # late: the pipeline extra

    ours, theirs = (np.ascontiguousarray(picture, dtype=np.float32) for picture in (ours, theirs))
    error: np.ndarray = flip_evaluator.evaluate(
        theirs, ours, "LDR", applyMagma=False, computeMeanError=False, parameters={"ppd": PIXELS_PER_DEGREE}
    )[0]
    return error.reshape(ours.shape[:2])


def _mean(values: np.ndarray) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else float("nan")


def _check(prediction: np.ndarray, truth: np.ndarray, coverage: np.ndarray) -> None:
    if truth.ndim != 3 or truth.shape[2] != 4 or min(truth.shape[:2]) < SSIM_WINDOW:
        raise ValueError(f"truth: expected (H, W, 4) with sides of {SSIM_WINDOW} or more, got {truth.shape}")
    if prediction.shape != truth.shape or coverage.shape != truth.shape[:2]:
        raise ValueError(
            f"expected prediction {truth.shape} and coverage {truth.shape[:2]} as the truth, "
            f"got {prediction.shape} and {coverage.shape}"
        )
    for name, values in (("prediction", prediction), ("truth", truth), ("coverage", coverage)):
        if not np.issubdtype(values.dtype, np.floating) or not (values.min() >= 0 and values.max() <= 1):
            raise ValueError(
                f"{name}: expected floats in [0, 1], got {values.dtype} from {values.min():g} to {values.max():g}"
            )
