"""Odd clouds and settings for `z2p_core.render`: a picture of the object in its frame, or an error that says why."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from changed_values import odd, plain

import z2p_core
from z2p_core.api.render import RenderWarning
from z2p_core.interfaces import ScanError, SettingError
from z2p_renderer.storage.models.checkpoints import WeightsError

CASE = "case.pickle"
WARNINGS = (RenderWarning,)
"""Kinds of warnings that are part of the answer."""
FAINTEST, SEEN = 24, 40
"""Alpha out of 255 that may lie on the border, a shadow that fades out, and above which a thing shows."""
GOOD: dict[str, tuple[Any, ...]] = {
    "up": (None, "auto", "+Z", "-Y", "+Y", "x"), "view": ("auto", "front", "sensor", (30, 20), (-400.5, 0), 45.0),
    "azimuth": (0, 90, -720.5, np.float32(3)), "color": ("red", "#fff", (0.1, 0.2, 0.3), np.array([1, 0, 0]), "tomato"),
    "light": ("3.6,-40,50", (3.1, 80, 30), [4.5, 0, 75]), "elevation": (0, 20, 80, np.int64(3)), "metallic": (0, 1.0),
    "roughness": (0.3,), "size": (64, (40, 90), 33, [128, 32], np.int32(50)), "background": (None, "white",
    "#ff000080", (1, 1, 1)),
    "supersample": (1, 2), "fit": ("frame", "tight"), "keep_outliers": (True, False), "cut_top": (0, 10, 99.9),
    "smooth": ("auto", 0, 0.1, 0.3), "weights": ("auto", "regular", "material"), "margin": (None, 0, 0.1, 0.3),
}  # fmt: skip
DTYPES = ("f2", "f4", "f8", "g", "i1", "u1", "i4", "u8", ">f4", ">i2", "?", "O", "c8", "S8", "U9", "M8[s]")


def make(rng: np.random.Generator, folder: Path) -> None:
    """A cloud and settings, of which some are odd."""
    settings: dict[str, Any] = {"size": 64}
    for name, values in GOOD.items():
        if rng.random() < 0.12:
            settings[name] = values[rng.integers(len(values))]
    if rng.random() < 0.25:
        name = str(rng.choice([*GOOD, "camera", "colors", "resolution", "nosuch"]))
        settings[name] = plain(odd(rng))
    points = _points(rng)
    if rng.random() < 0.1:
        settings["colors"] = _colors(points, rng)
    (folder / CASE).write_bytes(pickle.dumps((points, settings)))


def check(folder: Path) -> str:
    """What came of it."""
    points, settings = pickle.loads((folder / CASE).read_bytes())
    before = pickle.dumps(points)
    try:
        picture = z2p_core.render(points, **settings)
    except (ScanError, SettingError, WeightsError) as error:
        assert len(str(error)) < 2500 and "\n" not in str(error), f"a message that is no line: {str(error)[:300]!r}"
        return f"refused {type(error).__name__}"
    assert pickle.dumps(points) == before, "the cloud was changed"
    for one in picture:
        _check_picture(one, settings)
    return "drawn"


def _check_picture(picture: Any, settings: dict[str, Any]) -> None:
    """The object is to be seen, in its frame."""
    array = picture.array
    assert array.dtype == np.uint8 and array.ndim == 3 and array.shape[2] == 4, (array.dtype, array.shape)
    width, height = picture.record["resolution"]
    assert settings.get("fit") == "tight" or array.shape[:2] == (height, width), (array.shape, settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RenderWarning)
        assert picture._repr_png_().startswith(b"\x89PNG")
    if settings.get("background") is not None:
        return
    alpha = array[..., 3]
    faintest = 0 if settings.get("keep_outliers") else SEEN  # a stray may leave the object a speck
    assert alpha.max() > faintest, f"nothing is to be seen: alpha is {alpha.max()} at most"
    roomy = settings.get("margin") is None and not settings.get("keep_outliers") and "camera" not in settings
    if settings.get("fit", "frame") == "frame" and roomy:
        border = max(alpha[0].max(), alpha[-1].max(), alpha[:, 0].max(), alpha[:, -1].max())
        assert border <= FAINTEST, f"cut off at the border: alpha is {border} there"


def _points(rng: np.random.Generator) -> Any:
    """A cloud, or what somebody takes for one."""
    array = _cloud(rng)
    match int(rng.integers(14)):
        case 0 | 1 | 2 | 3:
            return array
        case 4:
            return _as_type(array, str(rng.choice(DTYPES)))
        case 5:
            return array[::-1, ::-1] if rng.random() < 0.5 else np.asfortranarray(array)
        case 6:
            return np.stack([array, array * 2]) if rng.random() < 0.5 else [array, array[: len(array) // 2]]
        case 7:
            return np.hstack([array, rng.normal(size=(len(array), int(rng.integers(1, 5))))])
        case 8:
            named = np.zeros(len(array), [("x", "f4"), ("y", "f8"), ("z", "f4"), ("label", "S3")])
            for axis, column in zip("xyz", array.T, strict=True):
                named[axis] = column
            return named
        case 9:
            return array.tolist() if rng.random() < 0.5 else array.T
        case 10:
            return dict(zip("xyz", array.T, strict=True)) if rng.random() < 0.5 else {"points": array}
        case 11:
            return np.ma.masked_array(array, rng.random(array.shape) < 0.1)
        case 12:
            array.setflags(write=False)
            return array
        case _:
            return plain(odd(rng))


def _cloud(rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) float64 of some shape, size, place and defects."""
    count = int(rng.choice([5, 7, 20, 100, 600]) if rng.random() < 0.8 else rng.integers(5))
    array = rng.normal(size=(count, 3))
    match int(rng.integers(10)):
        case 0:
            array /= np.linalg.norm(array, axis=1, keepdims=True)
        case 1:
            array[:, 1:] = 0  # a line
        case 2:
            array[:, 2] = 0
        case 3:
            array[:] = array[:1] if count else 0  # one place
        case 4:
            array[: count // 2] += 1000.0  # two clusters far apart
        case 5:
            array[rng.random(count) < 0.4] = rng.choice([np.nan, np.inf, -np.inf])
        case 6:
            array = np.round(array)  # repeats
        case 7:
            array[:1] = rng.choice([1e6, 1e30, 1e308, -3.4e38])  # a stray
        case 8:
            array[:, 2] *= 1e-6
        case _:
            pass
    with np.errstate(over="ignore", invalid="ignore"):
        scale, offset = rng.choice([1, 1e-3, 1e3]), rng.choice([0, 0, 5e6])
        if rng.random() < 0.15:
            scale, offset = rng.choice([1, 1e-320, 1e-160, 1e-40, 1e20, 1e37, 1e160]), rng.choice([0, 1e9, 1e15, 1e37])
        placed: np.ndarray = array * scale + offset * np.array([1, -2, 0.5])
        return placed


def _as_type(array: np.ndarray, dtype: str) -> np.ndarray:
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return (array * 20).astype(dtype)
        except (TypeError, ValueError, OverflowError):
            return array.astype("O")


def _colors(points: Any, rng: np.random.Generator) -> Any:
    count = len(points) if hasattr(points, "__len__") else 5
    table = rng.random(
        (count + int(rng.integers(-1, 2) if rng.random() < 0.2 else 0) if count else 0, int(rng.choice([3, 3, 4, 1])))
    )
    return [table, (table * 255).astype("u1"), table.astype("f2"), table * 300, table - 1, table.tolist(), table > 0.5,
            plain(odd(rng))][rng.integers(8)]  # fmt: skip
