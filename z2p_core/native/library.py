"""The compiled kernels and how they are called: with numpy arrays, without a lock, so threads run side by side."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.native.source_digest import LIBRARY


@lru_cache(maxsize=1)
def load_library() -> ctypes.CDLL:
    """The compiled kernels.

    Raises:
        ImportError: they were not compiled; the message says how.
    """
    path = Path(__file__).with_name(LIBRARY)
    if path.exists():
        return ctypes.CDLL(str(path))
    raise ImportError(
        f"z2p's compiled kernels are missing beside {__file__}; install a C compiler (Debian: apt-get install gcc "
        "libc6-dev) and z2p again (pip install .)"
    )


def call(name: str, *arguments: Any) -> None:
    """Calls a kernel with numbers, and arrays as places in memory.

    Raises:
        ImportError: the kernels are missing, or older than the code.
        MemoryError: there is not enough of it.
    """
    given = [_begin(x) if isinstance(x, np.ndarray) else x for x in arguments]
    kernel = getattr(load_library(), name, None)
    if kernel is None:
        raise ImportError(f"z2p's compiled kernels are older than its code: {name} is missing; install z2p again")
    if not kernel(*given):
        raise MemoryError(f"{name}: not enough memory")


def widest(name: str) -> str:
    """Of a kernel that is compiled for registers of sixteen numbers as well: the one that this processor is for."""
    return f"{name}_wide" if _is_wide() else name


@lru_cache(maxsize=1)
def _is_wide() -> bool:
    wide = np.zeros(1, np.int32)
    call("z2p_is_wide", wide)
    return bool(wide[0])


def _begin(array: Any) -> Any:
    """Where an array begins in memory; numpy itself takes four times as long to say, for some hundred a picture."""
    try:
        return ctypes.byref(ctypes.c_char.from_buffer(array))
    except (BufferError, TypeError, ValueError):  # not to be written to, with gaps between its rows, or empty
        return ctypes.c_void_p(array.ctypes.data)


def place(out: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """`out` itself, once it is sure that a kernel may write there."""
    if out.shape != shape or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise ValueError(f"expected a contiguous float32 array {shape} to draw into, got {out.dtype} {out.shape}")
    return out


def floats(array: np.ndarray) -> np.ndarray:
    """The array as kernels read it: float32 in one piece."""
    return np.ascontiguousarray(array, dtype=np.float32)
