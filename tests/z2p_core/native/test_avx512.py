"""Kernels that are compiled once more for wide registers make the same numbers."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
from collections.abc import Callable

import numpy as np
import pytest
from point_shapes import sphere_of

from z2p_core import native
from z2p_core.native import library
from z2p_core.surface.normals import fit_local_patches

Kernel = Callable[[np.random.Generator], tuple[np.ndarray, ...]]


def touched(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    cells, buffers = rng.random((64, 40, 50), dtype=np.float32), rng.random((5, 160, 200), dtype=np.float32)
    look, touch = (
        native.pack_convolution(0.3 * rng.standard_normal((units, read, 3, 3)), rng.standard_normal(units))
        for units, read in ((16, 9), (4, 16))
    )
    drawn = np.empty((4, 160, 200), np.float32)
    native.final_convs(cells, buffers, 4, look, touch, drawn)
    return (drawn,)


def refined(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    cloud = np.float32(sphere_of(1500) + 0.02 * rng.standard_normal((1500, 3)))
    own = fit_local_patches(cloud)
    return native.refine_normals(own.grid.points, own.normals, own.neighbors, own.scale, own.noise / own.median_spacing)


@pytest.mark.skipif(not library.has_avx512(), reason="this processor has no registers of sixteen numbers")
@pytest.mark.parametrize("kernel", [touched, refined])
def test_registers_of_any_width_make_the_same_numbers(kernel: Kernel, monkeypatch: pytest.MonkeyPatch) -> None:
    by_sixteen = kernel(np.random.default_rng(1))
    monkeypatch.setattr(library, "has_avx512", lambda: False)
    for wide, narrow in zip(by_sixteen, kernel(np.random.default_rng(1)), strict=True):
        assert np.array_equal(wide, narrow) and wide.std() > 0.01


@pytest.mark.skipif(
    platform.machine() != "x86_64" or not shutil.which("objdump"), reason="of x86-64's instructions, told by objdump"
)
def test_wide_registers_are_used_only_where_the_processor_was_asked_for_them() -> None:
    read = ["objdump", "-d", "--no-show-raw-insn", library.load_library()._name]
    told = subprocess.run(read, capture_output=True, text=True, check=True)
    functions = re.split(r"^[0-9a-f]+ <([^>]+)>:$", told.stdout, flags=re.MULTILINE)[1:]
    bodies = zip(functions[::2], functions[1::2], strict=True)
    wide = {name for name, body in bodies if re.search(r"%[yz]mm|\tv\w+ ", body)}
    assert len(functions) > 100
    assert [name for name in wide if not re.search(r"\.arch_?x86[-_]64[-_]v[34]|_wide(\.|$)", name)] == []
