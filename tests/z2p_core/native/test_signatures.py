"""Declared signatures are those of the C files, and calls with other arguments fail before C sees them."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from point_shapes import sphere_of

from z2p_core import native
from z2p_core.native import balls, library  # noqa: F401 - the first declares its kernels when it is imported
from z2p_core.native.library import FLOATS, SIGNATURES, Struct, call

C_FILES = sorted((Path(library.__file__).parent / "c").glob("*/*.[ch]"))
ALIASES = {"int32_t": "int", "unsigned char": "uint8_t"}
C_NUMBERS = {"float": ctypes.c_float, "int": ctypes.c_int, "int64_t": ctypes.c_int64}
"""Types of a structure's fields."""


def c_text() -> str:
    return re.sub(r"/\*.*?\*/|//[^\n]*", "", "\n".join(path.read_text() for path in C_FILES), flags=re.DOTALL)


def parameters_of(prototype: str) -> dict[str, str]:
    """Types of a C function's parameters by their names."""
    types = {}
    for parameter in prototype.split(","):
        words = re.fullmatch(r"\s*(const )?([\w ]+?)\s*(\**)\s*(?:restrict )?(\w+)\s*", parameter)
        assert words, parameter
        const, kind, stars, name = words.groups()
        types[name] = f"{const or ''}{ALIASES.get(kind, kind)}{stars}"
    return types


def exported() -> dict[str, dict[str, str]]:
    """Parameters of all functions that Python may call: those that return int and are named z2p_..."""
    prototypes = re.findall(r"^(?:FAST )?int (z2p_\w+)\(([^)]*)\)\s*\{", c_text(), flags=re.MULTILINE)
    return {name: parameters_of(parameters) for name, parameters in prototypes}


def declared() -> dict[str, dict[str, str]]:
    return {
        kernel: {name: parameter.c_type for name, parameter in signature.items()}
        for kernel, signature in SIGNATURES.items()
    }


def test_the_c_files_define_kernels() -> None:
    assert len(exported()) > 30


@pytest.mark.parametrize("kernel", sorted(exported() | declared()))
def test_declared_parameters_are_those_of_the_c_function(kernel: str) -> None:
    in_c, in_python = exported().get(kernel), declared().get(kernel)
    assert in_python == in_c
    assert list(in_python or ()) == list(in_c or ())  # in the same order


def structures() -> dict[str, type[ctypes.Structure]]:
    kinds = [kind for signature in SIGNATURES.values() for kind in signature.values() if isinstance(kind, Struct)]
    return {re.sub(r"const |\*", "", kind.c_type): kind.structure for kind in kinds}


@pytest.mark.parametrize("name", sorted(structures()))
def test_structures_have_the_fields_of_the_c_structure(name: str) -> None:
    body = re.search(r"typedef struct \{([^}]*)\} " + name + ";", c_text())
    assert body
    in_c: list[tuple[str, Any]] = []
    for kind, fields in re.findall(r"(\w+) ([^;]+);", body[1]):
        for field in fields.split(","):
            size = [int(length) for length in re.findall(r"\[(\d+)\]", field)]
            in_c.append((re.sub(r"\[.*", "", field).strip(), as_ctypes(C_NUMBERS[kind], size)))
    assert list(structures()[name]._fields_) == in_c


def as_ctypes(kind: Any, size: list[int]) -> Any:
    for length in reversed(size):
        kind = kind * length
    return kind


CLOUD = sphere_of(20).astype(np.float32)
NEIGHBORS = np.zeros((20, 8), np.int32)
NORMALS, SPREAD = np.zeros((20, 3), np.float32), np.zeros(20, np.float32)
READ_ONLY = np.zeros(20, np.float32)
READ_ONLY.flags.writeable = False

WRONG = {
    "swapped": ((NEIGHBORS, CLOUD, 20, 8, NORMALS, SPREAD), r"argument 1 \(points\): .* float32, got .* int32"),
    "missing": ((CLOUD, NEIGHBORS, 20, NORMALS, SPREAD), r"expected 6 arguments \(points, .*\), got 5"),
    "another dtype": ((CLOUD.astype(float), NEIGHBORS, 20, 8, NORMALS, SPREAD), r"float32, got .* of float64"),
    "not contiguous": ((CLOUD, NEIGHBORS[:, :4], 20, 4, NORMALS, SPREAD), r"argument 2 .*contiguous .* not contiguous"),
    "strided rows": ((CLOUD[::2], NEIGHBORS, 10, 8, NORMALS, SPREAD), r"argument 1 .*contiguous .* not contiguous"),
    "not an array": ((CLOUD, NEIGHBORS.tolist(), 20, 8, NORMALS, SPREAD), r"argument 2 .*int32, got list"),
    "None": ((CLOUD, None, 20, 8, NORMALS, SPREAD), r"argument 2 .*int32, got NoneType"),
    "a float for an int": ((CLOUD, NEIGHBORS, 20.0, 8, NORMALS, SPREAD), r"argument 3 .*integer .*got float 20.0"),
    "too large an int": ((CLOUD, NEIGHBORS, 2**31, 8, NORMALS, SPREAD), r"argument 3 .*integer of 32 bits, got int 2"),
    "read-only output": ((CLOUD, NEIGHBORS, 20, 8, NORMALS, READ_ONLY), r"argument 6 .*to write to, got .*read-only"),
}


def refuse(*_: object) -> int:
    raise AssertionError("a kernel was called with wrong arguments")


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_refused_before_the_call(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, message = WRONG[case]
    bind = library._bind
    monkeypatch.setattr(library, "_bind", lambda kernel: (refuse, *bind(kernel)[1:]))
    with pytest.raises(TypeError, match=message):
        call("z2p_fit_planes", *arguments)


def test_a_number_is_refused_where_it_is_text_or_an_array() -> None:
    for wrong in ("0.5", np.zeros(1), None):
        with pytest.raises(TypeError, match=r"argument 1 \(noise\): expected a number, got"):
            call("z2p_normal_gnn_begin", wrong, 20, NORMALS, NORMALS)


def test_arguments_are_taken_by_name_in_any_order() -> None:
    planes = [np.empty((20, 3), np.float32) for _ in range(2)]
    call("z2p_fit_planes", CLOUD, NEIGHBORS, 20, 8, planes[0], SPREAD)
    call("z2p_fit_planes", CLOUD, NEIGHBORS, spread=SPREAD, normals=planes[1], neighbor_count=8, count=20)
    np.testing.assert_array_equal(planes[0], planes[1])


@pytest.mark.parametrize(
    "named", [{"spread": SPREAD}, {"spread": SPREAD, "normals": NORMALS, "neighbor_count": 8, "counts": 20}]
)
def test_unknown_or_missing_names_are_refused(named: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=r"count.* missing, unknown or given twice; it takes points, "):
        call("z2p_fit_planes", CLOUD, NEIGHBORS, **named)


def test_kernels_older_than_the_code_say_to_install_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SIGNATURES, "z2p_newer", {"points": FLOATS})
    with pytest.raises(ImportError, match="z2p_newer is missing; install z2p again"):
        call("z2p_newer", CLOUD)


def test_a_kernel_is_declared_once() -> None:
    with pytest.raises(ValueError, match="z2p_fit_planes is declared twice"):
        library.declare("z2p_fit_planes", points=FLOATS)


def test_read_only_and_empty_arrays_are_read() -> None:
    cloud = CLOUD.copy()
    cloud.flags.writeable = False
    normals, spread = native.fit_planes(cloud, NEIGHBORS)
    assert normals.shape == (20, 3)
    call("z2p_fit_planes", cloud, NEIGHBORS[:0], 0, 8, normals[:0], spread[:0])


def test_constants_that_c_and_python_share_are_equal() -> None:
    from z2p_core.native import list_rows
    from z2p_core.surface import noise_level

    enum = re.search(r"enum \{ ((?:[IUF]\d, )+[IUF]\d) \};", c_text())
    assert enum and tuple(enum[1].lower().split(", ")) == list_rows._TYPES
    assert int(re.findall(r"#define MAX_NEIGHBORS (\d+)", c_text())[0]) == noise_level.MAX_NEIGHBORS
