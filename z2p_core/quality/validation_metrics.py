"""Fast metrics of a batch during training; the evaluation measures with `z2p_core.quality.metrics`."""

from __future__ import annotations

from torch import Tensor

from z2p_core.quality.losses import grey_on_white, rgb_on_white, ssim
from z2p_core.quality.metrics import FOREGROUND_COVERAGE


def validation_metrics(prediction: Tensor, target: Tensor, coverage: Tensor) -> dict[str, float]:
    """Means over a batch of premultiplied RGBA images (B, 4, H, W): PSNR on white and on the object, SSIM, L1 of alpha.

    `coverage` (B, 1, H, W) is the object's share of each pixel. SSIM is of the whole image in grey.
    """
    squared = (rgb_on_white(prediction) - rgb_on_white(target)).square()
    inside = (coverage > FOREGROUND_COVERAGE).to(squared.dtype)
    errors = {
        "psnr_white": squared.mean((1, 2, 3)),
        "psnr_foreground": (squared * inside).sum((1, 2, 3)) / (3 * inside.sum((1, 2, 3))).clamp_min(1),
    }
    row = {f"validation_{name}": float(-10 * error.clamp_min(1e-10).log10().mean()) for name, error in errors.items()}
    row["validation_ssim"] = float(ssim(grey_on_white(prediction), grey_on_white(target)).mean())
    row["validation_alpha_l1"] = float((prediction[:, 3] - target[:, 3]).abs().mean())
    return row
