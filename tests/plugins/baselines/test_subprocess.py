"""A call in a process of its own: its answers and errors come back, and one that hangs or dies does no harm."""

from __future__ import annotations

import os
import threading
import time

import pytest

from z2p_core.interfaces import ScanError
from z2p_renderer.plugins.baselines._subprocess import SubprocessFunction


def work(what: str) -> tuple[str, int]:
    if what == "hang":
        time.sleep(1000)
    if what == "slow":
        time.sleep(1)
    if what == "die":
        os._exit(7)
    if what == "fail":
        raise ValueError("no\nsuch thing")
    return what, os.getpid()


def test_calls_run_in_one_other_process() -> None:
    call = SubprocessFunction(work)
    (first, one), (second, other) = call("a", within=60), call("b", within=60)
    assert (first, second) == ("a", "b") and one == other != os.getpid()


def test_hanging_call_is_killed_and_the_next_one_works() -> None:
    call = SubprocessFunction(work)
    _, process = call("a", within=60)
    begin = time.monotonic()
    with pytest.raises(ScanError, match=r"work did not end within 0.5 s"):
        call("hang", within=0.5)
    assert time.monotonic() - begin < 30
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    assert call("b", within=60)[0] == "b"


def test_process_death_and_errors_are_reported() -> None:
    call = SubprocessFunction(work)
    with pytest.raises(ScanError, match=r"work died \(exit status 7\)"):
        call("die", within=60)
    with pytest.raises(ScanError, match="work: no such thing"):
        call("fail", within=60)
    assert call("a", within=60)[0] == "a"


def test_interrupt_leaves_no_result_for_the_next_call(monkeypatch: pytest.MonkeyPatch) -> None:
    call = SubprocessFunction(work)
    _, process = call("a", within=60)

    def interrupted(within: float) -> bool:
        raise KeyboardInterrupt

    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(type(call._pipe), "poll", lambda pipe, within: interrupted(within))
        with pytest.raises(KeyboardInterrupt):
            call("slow", within=60)
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    assert call("b", within=60)[0] == "b"


def test_threads_share_the_process() -> None:
    call, answers = SubprocessFunction(work), []
    threads = [threading.Thread(target=lambda n=n: answers.append(call(str(n), within=60)[0])) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answers) == ["0", "1", "2", "3"]
