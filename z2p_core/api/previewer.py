"""Pictures from inside a training loop: always an array, never an exception, the same camera every time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from z2p_core.api.backend import load_backend
from z2p_core.api.picture import tile_images
from z2p_core.api.render import RenderWarning, chosen_size, render
from z2p_core.coloring.options import LIMIT_PERCENTILES
from z2p_core.interfaces import ScanError, SettingError

DEFAULT_SIDE = 256
TRIAL_CLOUD = np.vstack([np.eye(3), -np.eye(3)])
"""A cloud to try the options with."""


class Previewer:
    """Draws clouds for a log: call it with points and hand the result to TensorBoard's `add_image`.

    The weights are loaded once, here. A cloud that cannot be drawn (NaN, collapsed to a point) becomes a grey picture
    that says why, for training must go on. torch's generator and settings are left as they were.
    """

    def __init__(
        self, *, size: int | Sequence[int] | None = None, resolution: int | Sequence[int] | None = None, most: int = 16,
        background: Any = "white", **options: Any,
    ) -> None:
        """Previewer of at most the first `most` clouds of a batch, 256 pixels each without `size` or `resolution`.

        `options` are those of `z2p_core.render`.

        The view is fixed (30 degrees to the side, 20 above) unless `view` or `camera` is given.

        Raises:
            ValueError: an option that cannot be; better now than after hours of training.
        """
        self._size = chosen_size(size, resolution, DEFAULT_SIDE)
        self._options = {"view": (30.0, 20.0), **options, "size": self._size, "background": background}
        self._most = most
        self.error: str | None = None
        """Why the newest call could not draw some cloud; None when it could."""
        with suppress(ScanError), warnings.catch_warnings():  # a camera for other data: not the options' fault
            warnings.simplefilter("ignore", RenderWarning)
            render(TRIAL_CLOUD, **self._options)

    def __call__(self, points: Any, colors: Any = None) -> np.ndarray:
        """Picture (3, H, W) uint8 of a cloud (N, 3), or a sheet of a batch (B, N, 3) or of a list of clouds.

        `colors` are as for `z2p_core.render`, of a batch one entry for each cloud. Scalars have one scale for the
        clouds of a call; give the previewer `clim` for one that stays.
        """
        return np.ascontiguousarray(self.picture(points, colors)[..., :3].transpose(2, 0, 1))

    def picture(self, points: Any, colors: Any = None) -> np.ndarray:
        """The same as (H, W, 4) uint8, as `matplotlib.pyplot.imshow` and `wandb.Image` take it."""
        self.error = None
        try:
            rank = len(points.shape) if hasattr(points, "shape") else 0
            batch = rank == 3 or (isinstance(points, list | tuple) and np.ndim(points[0] if points else 0) != 1)
            clouds = list(points[: self._most]) if batch else [points]
            is_split = batch and colors is not None and not isinstance(colors, str)
            parts = list(colors[: self._most]) if is_split else [colors] * len(clouds)
            if len(parts) != len(clouds):
                raise SettingError(f"expected colors for each of {len(clouds)} clouds, got {len(parts)}")
            limits = _common_limits(parts) if is_split else {}
        except Exception as error:  # whatever a stranger's tensor raises: see the class
            return self._notice(error)
        pictures = [self._drawn(cloud, {**limits, **self._options, **({} if part is None else {"colors": part})})
                    for cloud, part in zip(clouds, parts, strict=True)]  # fmt: skip
        return tile_images(pictures) if pictures else self._notice(ValueError("an empty batch"))

    def _drawn(self, cloud: Any, options: Mapping[str, Any]) -> np.ndarray:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RenderWarning)  # once a call would drown the training's own lines
                return render(cloud, **options).array
        except Exception as error:  # the class's promise
            return self._notice(error)

    def _notice(self, error: Exception) -> np.ndarray:
        self.error = " ".join(str(error).split()) or type(error).__name__
        with suppress(RenderWarning):  # where warnings were made errors
            warnings.warn(f"preview: {self.error}", RenderWarning, stacklevel=4)
        return load_backend().draw_message(self.error, self._size)


def _common_limits(parts: Sequence[Any]) -> dict[str, Any]:
    """The option `clim` for scalars (N,) of several clouds: the percentiles that `render` takes of one; else none."""
    arrays = [part.detach().cpu().numpy() if hasattr(part, "detach") else np.asarray(part) for part in parts]
    if any(array.ndim != 1 or array.dtype.kind != "f" for array in arrays):
        return {}
    values = np.concatenate(arrays)
    values = values[np.isfinite(values)]
    if not len(values) or values.min() == values.max():
        return {}
    low, high = np.percentile(values, LIMIT_PERCENTILES).tolist()
    return {"clim": (low, high) if low < high else (float(values.min()), float(values.max()))}
