"""Locks of a store: a look at one leaves nothing behind."""

import fcntl
import os
import signal

from storage.layout import Entry, Store


def test_a_look_at_a_lock_leaves_none_in_a_process_forked_meanwhile(tmp_path, monkeypatch):
    store, one = Store(tmp_path / "runs"), Entry("sample", "sample/bunny", {"stage": "sample"}, {})
    flock, children = fcntl.flock, []
    with store.lock(one):
        pass  # its file is there

    def forking(file, how):
        flock(file, how)
        if how & fcntl.LOCK_SH:
            children.append(os.fork())
            if not children[-1]:
                signal.pause()

    monkeypatch.setattr(fcntl, "flock", forking)
    try:
        assert not store.is_held(one.stage, one.fingerprint[:32])
        monkeypatch.setattr(fcntl, "flock", flock)
        (path,) = store.root.glob(".locks/**/*" + one.fingerprint[:32] + "*")
        with path.open("a+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        for child in children:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
