"""What libraries say while a file is read reaches nobody; all else does, then and afterwards."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
import warnings

import numpy as np
import pytest

from z2p_renderer.storage.scans.silenced_libraries import quiet


def warn(module: str) -> None:
    """As a library's module does."""
    warnings.warn_explicit("of no use", UserWarning, "somewhere.py", 1, module=module)


def test_only_library_warnings_inside_quiet_are_suppressed() -> None:
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        before = list(warnings.filters)
        with quiet():
            warn("trimesh.exchange.gltf")
            warn("numpy")
            warn("z2p_renderer.plugins.readers.ply")
            with quiet():
                warn("laspy.header")
            warn("laspy.header")
            assert not shown
            warn("a_users_script")
            warn("trimeshes")
            assert len(shown) == 2
            with np.errstate(all="raise"), pytest.raises(FloatingPointError):
                np.float64(1) / np.float64(0)  # the caller's own wish
            np.float64(1) / np.float64(0)
        warn("laspy.header")
        assert len(shown) == 3 and list(warnings.filters) == before


def test_parallel_reading_restores_warning_filters() -> None:
    before = list(warnings.filters)
    barrier = threading.Barrier(4)

    def read() -> None:
        for _ in range(50):
            with quiet():
                pass
        barrier.wait()

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert list(warnings.filters) == before


def test_library_logs_are_silent_unless_configured() -> None:
    code = ("import logging, sys; from z2p_renderer.storage.scans.silenced_libraries import quiet\n"
            "if len(sys.argv) > 1: logging.basicConfig(format='%(message)s')\n"
            "with quiet(): logging.getLogger('laspy.lasreader').error('within')\n"
            "logging.getLogger('laspy.lasreader').error('after')\n")  # fmt: skip
    for more, shown in ([], ["after"]), (["asked"], ["within", "after"]):
        done = subprocess.run([sys.executable, "-c", code, *more], capture_output=True, text=True, check=True)
        assert done.stderr.split() == shown
    assert logging.lastResort is not None and not logging.lastResort.filters
