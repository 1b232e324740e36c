"""What lies around the code: pinned versions, the sample scans, and a README whose links lead somewhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from z2p_renderer.storage.scans.clouds import read_clouds

ROOT = Path(__file__).parents[2]
SAMPLES = ("amphora.ply", "chair.ply", "knot.xyz", "painted.ply", "suzanne.ply")


def requirements() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    names = {re.split(r"[<>=;\[ ]", line)[0].lower() for group in groups for line in group}
    return names - {project["name"]}  # an extra may take in others of its own


def test_every_direct_dependency_is_pinned_and_nothing_else() -> None:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and line[0] != "#"]
    pin = r"[a-z0-9-]+==[0-9.]+(; python_version (<|>=) \"3\.[0-9]+\")?"  # some are others for some Pythons
    assert all(re.fullmatch(pin, line) for line in lines)
    assert {line.split("==")[0] for line in lines} == requirements()


def test_the_samples_are_small_scans() -> None:
    assert tuple(sorted(path.name for path in (ROOT / "samples").iterdir())) == SAMPLES
    assert sum((ROOT / "samples" / name).stat().st_size for name in SAMPLES) < 1_500_000
    for name in SAMPLES:
        (scan,) = read_clouds(ROOT / "samples" / name)
        assert 4_000 <= len(scan.points) <= 15_000 and scan.dropped == 0


@pytest.mark.parametrize("name", [*SAMPLES[:4], pytest.param(SAMPLES[4], marks=pytest.mark.slow)])
def test_the_script_makes_the_samples_that_are_here(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    from make_samples import make_sample

    made, here = make_sample(name), read_clouds(ROOT / "samples" / name)[0].points
    # another machine's sines may move a point into the next pixel
    assert len(made) == pytest.approx(len(here), rel=0.02)
    np.testing.assert_allclose(made.mean(0), here.mean(0), atol=0.02 * np.ptp(here))
    np.testing.assert_allclose(made.std(0), here.std(0), atol=0.02 * np.ptp(here))


@pytest.mark.parametrize("page", ["README.md", "docs/writing-a-control.md", "examples/plugins/z2p-coat/README.md"])
def test_links_lead_somewhere(page: str) -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", (ROOT / page).read_text())
    assert links
    missing = [link for link in links if not ((ROOT / page).parent / link).exists()]
    assert not missing, f"{page} links to {', '.join(missing)}"
