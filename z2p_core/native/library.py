"""Checked calls of the compiled kernels: C functions that work on numpy arrays.

A bindings module (`points.py`, `surfels.py`, `lighting.py`, `images.py`, `list_rows.py`: one for each folder of `c/`)
declares every C function that it calls, once, at its top, with the parameters' names and order of the C prototype:

    declare("z2p_fit_planes", points=FLOATS, neighbors=INTS, begin=INT, end=INT, normals=FLOATS_OUT)

and calls it by position, by name, or both:

    call("z2p_fit_planes", points, neighbors, begin=0, end=len(neighbors), normals=normals)

`call` raises `TypeError` before anything runs if an argument is missing, unknown or of another type. Array kinds fix
dtype and memory order: `FLOATS` float32, `DOUBLES` float64, `INTS` int32, `INT64S` int64, `BYTES` uint8; all contiguous
in C order. `..._OUT` kinds are written to, so they refuse read-only arrays. `..._OR_NONE` kinds take None for NULL and
`FLOAT_ROWS` rows that lie apart. Plain Python numbers are passed for `INT`, `INT64` and `FLOAT`, without `ctypes`.
Values that go by the dozen are one structure: a `ctypes.Structure`, declared as `Struct(FloorStruct, "Floor")` with the
name of the C typedef, and passed as an instance. Shapes are not checked here, but by the bindings. A binding that
draws into a caller's array checks it by `check_output`.

`tests/z2p_core/native/test_signatures.py` compares all declarations, and the fields of structures, with the C files.

Why ctypes: the kernels are one plain library that serves every Python version, so a wheel or a compiled checkout
survives a new Python, and no compiler is needed where z2p is installed from a wheel. nanobind and cffi's API mode
compile an extension for each Python version (or need the stable ABI of 3.12); cffi's ABI mode parses C declarations at
every start and checks neither dtypes nor contiguity. Calls hold no lock, so threads run side by side.
"""

from __future__ import annotations

import ctypes
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.native.source_digest import LIBRARY_NAME

WIDE_SUFFIX = "_wide"
"""Ends the names of kernels that `c/common/avx512.c` compiles once more; they share the plain kernel's signature."""


class ArgumentType:
    """How an argument is checked and passed on.

    Attributes:
        c_type: the parameter's type in C, without spaces around ``*``, such as ``const float*``.
        ctypes_type: what ctypes converts the passed value to.
    """

    c_type: str
    ctypes_type: Any

    def convert(self, value: Any) -> Any:
        """The value as ctypes takes it.

        Raises:
            TypeError: another type of value; the message says what was expected and what was given.
        """
        raise NotImplementedError


class Integer(ArgumentType):
    """An integer of so many bits."""

    def __init__(self, c_type: str, bits: int) -> None:
        self.c_type, self.bits = c_type, bits
        self.ctypes_type = {32: ctypes.c_int32, 64: ctypes.c_int64}[bits]
        self.least, self.greatest = -(2 ** (bits - 1)), 2 ** (bits - 1) - 1

    def convert(self, value: Any) -> int:
        if type(value) is int and self.least <= value <= self.greatest:
            return value
        if isinstance(value, (int, np.integer)) and self.least <= value <= self.greatest:
            return int(value)
        raise TypeError(f"expected an integer of {self.bits} bits, got {_describe(value)}")


class Float(ArgumentType):
    """A number that C takes as a float of 32 bits."""

    c_type, ctypes_type = "float", ctypes.c_float

    def convert(self, value: Any) -> float:
        if type(value) is float:
            return value
        if not isinstance(value, (int, float, np.number)):
            raise TypeError(f"expected a number, got {_describe(value)}")
        return float(value)


class Array(ArgumentType):
    """A pointer to the first element of an array of one dtype.

    Args:
        c_type: the element's type in C.
        dtype: the array's dtype.
        is_output: the kernel writes to it.
        is_optional: None is passed on as NULL.
        is_strided: only the last axis has to be contiguous; the kernel takes the rows' distance as a parameter.
    """

    ctypes_type = ctypes.c_void_p

    def __init__(
        self, c_type: str, dtype: Any, is_output: bool = False, is_optional: bool = False, is_strided: bool = False
    ) -> None:
        self.c_type = f"{c_type}*" if is_output else f"const {c_type}*"
        self.dtype = np.dtype(dtype)
        self.is_output, self.is_optional, self.is_strided = is_output, is_optional, is_strided

    def convert(self, value: Any) -> Any:
        try:  # four times as fast as numpy's own ways to the address; refuses arrays with gaps, read-only or empty
            if value.dtype is self.dtype:
                return ctypes.byref(ctypes.c_char.from_buffer(value))
        except (AttributeError, BufferError, TypeError, ValueError):
            pass
        if value is None and self.is_optional:
            return None
        if not isinstance(value, np.ndarray) or value.dtype != self.dtype or not self._is_readable(value):
            raise TypeError(f"expected {self._expectation()}, got {_describe(value)}")
        if self.is_output and not value.flags.writeable:
            raise TypeError(f"expected {self._expectation()}, got {_describe(value)}, which is read-only")
        return ctypes.c_void_p(value.ctypes.data)

    def _is_readable(self, array: np.ndarray) -> bool:
        contiguous: bool = array.flags.c_contiguous
        return contiguous or (self.is_strided and array.ndim > 0 and array.strides[-1] == array.itemsize)

    def _expectation(self) -> str:
        order = "array of contiguous rows" if self.is_strided else "contiguous array"
        return f"a {order} of {self.dtype}" + (" to write to" if self.is_output else "")


class Struct(ArgumentType):
    """A pointer to a structure that the kernel reads.

    Args:
        structure: the subclass of `ctypes.Structure` that mirrors it.
        c_name: name of the C typedef, if it differs from the class's.
    """

    ctypes_type = ctypes.c_void_p

    def __init__(self, structure: type[ctypes.Structure], c_name: str = "") -> None:
        self.structure, self.c_type = structure, f"const {c_name or structure.__name__}*"

    def convert(self, value: Any) -> Any:
        if not isinstance(value, self.structure):
            raise TypeError(f"expected a structure {self.structure.__name__}, got {_describe(value)}")
        return ctypes.byref(value)


class Handle(ArgumentType):
    """A pointer to an object that C allocated, kept in Python as a `ctypes.c_void_p`.

    Args:
        c_type: the parameter's type in C.
        is_output: the kernel sets it.
    """

    ctypes_type = ctypes.c_void_p

    def __init__(self, c_type: str, is_output: bool = False) -> None:
        self.c_type, self.is_output = c_type, is_output

    def convert(self, value: Any) -> Any:
        if not isinstance(value, ctypes.c_void_p) or (value.value is None and not self.is_output):
            raise TypeError(f"expected a handle of {self.c_type}, got {_describe(value)}")
        return ctypes.byref(value) if self.is_output else value


INT, INT64, FLOAT = Integer("int", 32), Integer("int64_t", 64), Float()
FLOATS, FLOATS_OUT = Array("float", np.float32), Array("float", np.float32, is_output=True)
DOUBLES, DOUBLES_OUT = Array("double", np.float64), Array("double", np.float64, is_output=True)
INTS, INTS_OUT = Array("int", np.int32), Array("int", np.int32, is_output=True)
INT64S, INT64S_OUT = Array("int64_t", np.int64), Array("int64_t", np.int64, is_output=True)
BYTES, BYTES_OUT = Array("uint8_t", np.uint8), Array("uint8_t", np.uint8, is_output=True)
FLOATS_OR_NONE = Array("float", np.float32, is_optional=True)
FLOATS_OUT_OR_NONE = Array("float", np.float32, is_output=True, is_optional=True)
FLOAT_ROWS = Array("float", np.float32, is_strided=True)

SIGNATURES: dict[str, dict[str, ArgumentType]] = {}
"""Parameters of every declared kernel, by name, in the order of the C prototype."""


def declare(kernel: str, /, **parameters: ArgumentType) -> None:
    """Declares a C function ``int kernel(...)``, which returns 0 if it ran out of memory.

    Raises:
        ValueError: it was declared already.
    """
    if kernel in SIGNATURES:
        raise ValueError(f"{kernel} is declared twice")
    SIGNATURES[kernel] = parameters


def call(kernel: str, /, *arguments: Any, **named: Any) -> None:
    """Calls a declared kernel with its arguments in the order of its parameters, or by their names.

    Raises:
        ImportError: the compiled kernels are missing, or older than the code.
        MemoryError: the kernel ran out of memory.
        TypeError: an argument is missing, unknown, or not of the declared type.
    """
    function, parameters, converters = _bind(kernel)
    if named:
        arguments = _in_order(kernel, parameters, arguments, named)
    if len(arguments) != len(converters):
        expected = f"{len(converters)} arguments ({', '.join(parameters)})"
        raise TypeError(f"{kernel}: expected {expected}, got {len(arguments)}")
    try:
        converted = [convert(argument) for convert, argument in zip(converters, arguments, strict=True)]
    except TypeError:
        _raise_for_the_wrong_one(kernel, parameters, arguments)
        raise
    if not function(*converted):
        raise MemoryError(f"{kernel}: not enough memory")


@cache
def _bind(kernel: str) -> tuple[Any, dict[str, ArgumentType], list[Any]]:
    """The C function, its parameters, and what converts an argument for each of them."""
    parameters = SIGNATURES[kernel.removesuffix(WIDE_SUFFIX)]
    function = getattr(load_library(), kernel, None)
    if function is None:
        raise ImportError(f"z2p's compiled kernels are older than its code: {kernel} is missing; install z2p again")
    function.argtypes = [parameter.ctypes_type for parameter in parameters.values()]
    function.restype = ctypes.c_int
    return function, parameters, [parameter.convert for parameter in parameters.values()]


def _in_order(
    kernel: str, parameters: dict[str, ArgumentType], arguments: tuple[Any, ...], named: dict[str, Any]
) -> tuple[Any, ...]:
    """All arguments by position: those given so, then those given by name."""
    left = list(parameters)[len(arguments) :]
    if left != list(named) and set(left) != set(named):
        wrong = ", ".join(sorted(set(left) ^ set(named)))
        raise TypeError(f"{kernel}: {wrong} missing, unknown or given twice; it takes {', '.join(parameters)}")
    return (*arguments, *(named[name] for name in left))


def _raise_for_the_wrong_one(kernel: str, parameters: dict[str, ArgumentType], arguments: tuple[Any, ...]) -> None:
    for place, ((name, parameter), argument) in enumerate(zip(parameters.items(), arguments, strict=True), 1):
        try:
            parameter.convert(argument)
        except TypeError as error:
            raise TypeError(f"{kernel}, argument {place} ({name}): {error}") from None


def _describe(value: Any) -> str:
    if isinstance(value, np.ndarray):
        order = "" if value.flags.c_contiguous else f" that is not contiguous (strides {value.strides})"
        return f"an array {value.shape} of {value.dtype}{order}"
    return f"{type(value).__name__} {value!r:.60}"


@lru_cache(maxsize=1)
def load_library() -> ctypes.CDLL:
    """The compiled kernels.

    Raises:
        ImportError: they were not compiled; the message says how.
    """
    path = Path(__file__).with_name(LIBRARY_NAME)
    if path.exists():
        return ctypes.CDLL(str(path))
    raise ImportError(
        f"z2p's compiled kernels are missing beside {__file__}; install a C compiler (Debian: apt-get install gcc "
        "libc6-dev) and z2p again (pip install .)"
    )


declare("z2p_has_avx512", has_avx512=INTS_OUT)


def select_variant(kernel: str) -> str:
    """Name of the variant of a kernel that suits this processor: with 16 lanes if it has AVX-512, else with 8.

    Only for kernels that `c/common/avx512.c` compiles once more.
    """
    return f"{kernel}{WIDE_SUFFIX}" if has_avx512() else kernel


@lru_cache(maxsize=1)
def has_avx512() -> bool:
    wide = np.zeros(1, np.int32)
    call("z2p_has_avx512", wide)
    return bool(wide[0])


def check_output(out: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """`out` itself, if it is a contiguous float32 array of that shape, which a kernel may write to.

    Raises:
        ValueError: it is not.
    """
    if out.shape != shape or out.dtype != np.float32 or not out.flags.c_contiguous:
        expected = tuple(map(int, shape))
        raise ValueError(f"expected a contiguous float32 array {expected} to draw into, got {out.dtype} {out.shape}")
    return out


def as_float32(array: np.ndarray) -> np.ndarray:
    """The array as a contiguous float32 array; itself if it is one."""
    return np.ascontiguousarray(array, dtype=np.float32)
