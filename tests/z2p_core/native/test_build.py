"""Kernels are built as one plain library for every Python, and a machine without a compiler is told so in one line."""

from __future__ import annotations

import pytest

from z2p_core.native.source_digest import LIBRARY

pytest.importorskip("setuptools")  # which builds, and is not always where z2p runs
from z2p_core.native import build, wheels


def library(*versions: str) -> bytes:
    return b"\0".join([b"\x7fELF", b"libm.so.6", *(name.encode() for name in versions), b""])


def test_a_wheel_names_the_oldest_c_library_that_has_what_its_own_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wheels.sys, "platform", "linux")
    monkeypatch.setattr(wheels.sysconfig, "get_platform", lambda: "linux-aarch64")
    tag = wheels.platform_tag
    assert tag("linux_aarch64", library("GLIBC_2.2.5", "GLIBC_2.14")) == "manylinux_2_17_aarch64"
    assert tag("linux_aarch64", library("GLIBC_2.2.5", "GLIBC_2.34", "GLIBC_2.4")) == "manylinux_2_34_aarch64"
    assert tag("linux_aarch64", library()) == "linux_aarch64"  # musl's
    monkeypatch.setattr(wheels.sys, "platform", "darwin")
    assert tag("macosx_11_0_arm64", library("GLIBC_2.17")) == "macosx_11_0_arm64"


def test_no_python_is_in_the_librarys_name() -> None:
    assert LIBRARY in ("kernels.so", "kernels.dll")


def test_without_a_compiler_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -pthread")
    with pytest.raises(SystemExit, match=r"no no-such-compiler here; install one .*apt-get install gcc") as told:
        build.find_compiler()
    assert "\n" not in str(told.value)


def test_a_usual_compiler_stands_in_for_the_one_that_built_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "")  # set again by the code under test, and so put back after it
    monkeypatch.setattr(build.sysconfig, "get_config_var", lambda name: "no-such-compiler -pthread")
    monkeypatch.setattr(build.shutil, "which", lambda name: name if name == "clang" else None)
    build.find_compiler()
    assert build.os.environ["CC"] == "clang"
