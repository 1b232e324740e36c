"""Kernels that are compiled once more for AVX-512 give the same results."""

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


def convolved(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    cells, buffers = rng.random((64, 40, 50), dtype=np.float32), rng.random((5, 160, 200), dtype=np.float32)
    first, last = (
        native.pack_convolution(0.3 * rng.standard_normal((outputs, inputs, 3, 3)), rng.standard_normal(outputs))
        for outputs, inputs in ((16, 9), (4, 16))
    )
    drawn = np.empty((4, 160, 200), np.float32)
    native.final_convs(cells, buffers, 4, first, last, drawn)
    return (drawn,)


def refined(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    cloud = np.float32(sphere_of(1500) + 0.02 * rng.standard_normal((1500, 3)))
    fit = fit_local_patches(cloud)
    return native.refine_normals(fit.grid.points, fit.normals, fit.neighbors, fit.scale, fit.noise / fit.median_spacing)


@pytest.mark.skipif(not library.has_avx512(), reason="this processor has no AVX-512")
@pytest.mark.parametrize("kernel", [convolved, refined])
def test_avx512_and_plain_kernels_have_equal_results(kernel: Kernel, monkeypatch: pytest.MonkeyPatch) -> None:
    wide_results = kernel(np.random.default_rng(1))
    monkeypatch.setattr(library, "has_avx512", lambda: False)
    for wide, narrow in zip(wide_results, kernel(np.random.default_rng(1)), strict=True):
        assert np.array_equal(wide, narrow) and wide.std() > 0.01


@pytest.mark.skipif(
    platform.machine() != "x86_64" or not shutil.which("objdump"), reason="needs x86-64 and objdump"
)
def test_plain_functions_contain_no_avx_instructions() -> None:
    command = ["objdump", "-d", "--no-show-raw-insn", library.load_library()._name]
    listing = subprocess.run(command, capture_output=True, text=True, check=True)
    functions = re.split(r"^[0-9a-f]+ <([^>]+)>:$", listing.stdout, flags=re.MULTILINE)[1:]
    bodies = zip(functions[::2], functions[1::2], strict=True)
    wide = {name for name, body in bodies if re.search(r"%[yz]mm|\tv\w+ ", body)}
    assert len(functions) > 100
    assert [name for name in wide if not re.search(r"\.arch_?x86[-_]64[-_]v[34]|_wide(\.|$)", name)] == []
