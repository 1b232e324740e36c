"""A small share of what `make fuzz` tries, always the same, and that those who look for faults see them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import fuzz_readers
import numpy as np
import pytest
from made_scans import MADE
from workers import Outcome, Worker

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import Scan, read_each, readable_suffixes

SEED = 47
INPUTS = {"readers": 70, "records": 40, "weights": 30, "results": 10, "configs": 12, "render": 24, "commands": 10}
"""How many inputs are tried of each target."""
SIGNS = {"readers": "read", "records": "read", "weights": "loaded", "results": "changed", "configs": "planned",
         "render": "drawn", "commands": " 0"}  # fmt: skip
"""What is said of some of them, and not of all."""
FAULTS = """
import ctypes, json, os, sys, time, warnings
def make(rng, folder):
    (folder / "number").write_text(str(rng.integers(2**40)))
def check(folder):
    match {what!r}:
        case "death": os._exit(3)
        case "crash": ctypes.string_at(0)
        case "hang": time.sleep(1000)
        case "flood": bytearray(1 << 40)
        case "error": raise KeyError("x")
        case "exit": sys.exit(0)
        case "warning": warnings.warn("look out")
        case "print": print("look out")
        case "print of a child": os.system("echo look out >&2")
    return "well"
"""


@pytest.fixture(autouse=True, scope="module")
def extras() -> None:
    """A light installation has less to attack."""
    for extra in ("torch", "h5py", "luigi", "pye57"):
        pytest.importorskip(extra)


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.close()


@pytest.mark.slow
@pytest.mark.parametrize("target", INPUTS)
def test_odd_inputs_are_taken_or_refused(target: str, worker: Worker) -> None:
    labels: Counter[str] = Counter()
    for number in range(INPUTS[target]):
        outcome = worker.attempt(target, (SEED, number))
        again = f"python tests/fuzz/run.py {target} --seed {SEED} --number {number}"
        assert not outcome.fault, f"{again}\n{outcome.fault}"
        labels[outcome.label] += 1
    some = sum(count for label, count in labels.items() if SIGNS[target] in label)
    assert 0 < some < INPUTS[target], labels


@pytest.mark.slow
@pytest.mark.parametrize(
    "what", ["death", "crash", "hang", "flood", "error", "exit", "warning", "print", "print of a child"]
)
def test_every_kind_of_fault_is_seen_and_kept(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "fuzz_made.py").write_text(FAULTS.format(what=what))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    kept = tmp_path / "kept"
    outcome = attempt((0, 1), kept)
    assert outcome.fault and outcome.kind
    assert (kept / "number").exists() and (kept / "fault.txt").read_text() == outcome.fault
    (tmp_path / "fuzz_made.py").write_text(FAULTS.format(what="nothing"))
    assert attempt(kept, None).label == "well"


def attempt(seed: tuple[int, int] | Path, keep: Path | None) -> Outcome:
    """What comes of an input of the target ``made``, in a process of its own."""
    worker = Worker(seconds=3)
    try:
        return worker.attempt("made", seed, keep)
    finally:
        worker.close()


def test_a_seed_and_a_number_make_one_input_and_others_another(tmp_path: Path) -> None:
    made = []
    for folder, number in (("a", 3), ("b", 3), ("c", 5)):
        (tmp_path / folder).mkdir()
        fuzz_readers.make(np.random.default_rng([1, number]), tmp_path / folder)
        made.append({path.name: path.read_bytes() for path in (tmp_path / folder).iterdir()})
    assert made[0] == made[1] != made[2]


def test_fuzzing_covers_every_readable_format(tmp_path: Path) -> None:
    assert set(readable_suffixes()) <= set(MADE)
    rng = np.random.default_rng(2)
    for suffix in readable_suffixes():
        for maker in MADE[suffix] * 3:
            given = maker(rng)
            files = {f"scan{suffix}": given} if isinstance(given, bytes) else given
            for name, blob in files.items():
                (tmp_path / name).write_bytes(blob)
            try:
                if isinstance(read_each(tmp_path / next(iter(files)))[0], Scan):
                    break
            except ScanError:
                continue
        else:
            pytest.fail(f"no {suffix} is read")
