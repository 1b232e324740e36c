"""The names of wheels and of the compiled library, and the choice of the compiler."""

from __future__ import annotations

import pytest

from z2p_core.native.source_digest import LIBRARY_NAME

pytest.importorskip("setuptools")  # which builds, and is not always where z2p runs
from z2p_core.native import build, wheels


def library_needing(*versions: str) -> bytes:
    return b"\0".join([b"\x7fELF", b"libm.so.6", *(name.encode() for name in versions), b""])


def test_wheels_are_named_after_the_oldest_sufficient_libc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wheels.sys, "platform", "linux")
    monkeypatch.setattr(wheels.sysconfig, "get_platform", lambda: "linux-aarch64")
    tag = wheels.platform_tag
    assert tag("linux_aarch64", library_needing("GLIBC_2.2.5", "GLIBC_2.14")) == "manylinux_2_17_aarch64"
    assert tag("linux_aarch64", library_needing("GLIBC_2.2.5", "GLIBC_2.34", "GLIBC_2.4")) == "manylinux_2_34_aarch64"
    assert tag("linux_aarch64", library_needing()) == "linux_aarch64"  # musl's
    monkeypatch.setattr(wheels.sys, "platform", "darwin")
    assert tag("macosx_11_0_arm64", library_needing("GLIBC_2.17")) == "macosx_11_0_arm64"


def test_the_librarys_name_has_no_python_version() -> None:
    assert LIBRARY_NAME in ("kernels.so", "kernels.dll")


def test_without_a_compiler_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -pthread")
    with pytest.raises(SystemExit, match=r"no no-such-compiler here; install one .*apt-get install gcc") as exit_error:
        build.select_compiler()
    assert "\n" not in str(exit_error.value)


def test_a_missing_compiler_is_replaced_by_a_usual_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "")  # the code under test sets it, and monkeypatch restores it
    monkeypatch.setattr(build.sysconfig, "get_config_var", lambda name: "no-such-compiler -pthread")
    monkeypatch.setattr(build.shutil, "which", lambda name: name if name == "clang" else None)
    build.select_compiler()
    assert build.os.environ["CC"] == "clang"
