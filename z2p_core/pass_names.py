"""Names of the passes that can be drawn beside a picture; `z2p_core.shading.passes` draws them."""

from __future__ import annotations

from collections.abc import Sequence

from z2p_core.interfaces import SettingError

PASSES = ("depth", "normal", "albedo", "alpha", "position", "trust")
"""Names of the passes.

======== =========== ===================================================================================================
name     shape       meaning; NaN where there is no surface, alpha and trust 0
======== =========== ===================================================================================================
depth    (H, W)      distance along the optical axis, in the data's units
normal   (H, W, 3)   unit normal in the data's axes, towards the camera
albedo   (H, W, 3)   base color, linear, in [0, 1]
alpha    (H, W)      share of the pixel that the surface covers; the floor and its shadow do not count
position (H, W, 3)   the data's coordinates of the surface at the middle of the pixel
trust    (H, W)      how well points support the surface: 1 within one sampled as densely as the cloud is on the median;
                     half where points lie twice as far apart; about a third at a border; 0 where a hole was closed
======== =========== ===================================================================================================
"""


def parse_passes(wish: str | Sequence[str] | None) -> tuple[str, ...]:
    """Names of passes, each once, from a list, or a text with commas; ``all`` stands for all.

    Raises:
        SettingError: there is no such pass.
    """
    if wish is None:
        return ()
    names = [name.strip().lower() for name in (wish.split(",") if isinstance(wish, str) else map(str, wish))]
    if names == ["all"]:
        return PASSES
    unknown = [name for name in names if name not in PASSES]
    if unknown:
        raise SettingError(f"passes: expected some of {', '.join(PASSES)}, or all, got {unknown[0]!r}")
    return tuple(dict.fromkeys(names))
