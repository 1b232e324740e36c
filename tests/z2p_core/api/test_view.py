"""`z2p_core.view` shows points inline, and ends."""

from __future__ import annotations

import json
import urllib.error
import urllib.request

import numpy as np
import pytest

import z2p_core


def test_points_with_values_are_shown_until_the_viewer_is_closed() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    viewer = z2p_core.view(points, colors=points[:, 0])
    described = json.load(urllib.request.urlopen(f"{viewer.address}description", data=b"{}", timeout=30))
    assert described["fields"] == ["values"] and described["up"] == "+Z"
    assert described["color_by"] == "values"  # as z2p_core.render shows them
    assert viewer.address in viewer._repr_html_() and "<iframe" in viewer._repr_html_()
    viewer.close()
    viewer.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(viewer.address, timeout=5)
