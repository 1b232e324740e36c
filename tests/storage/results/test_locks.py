"""Locks of a store: a look at one leaves nothing behind."""

import fcntl
import os

from z2p_renderer.storage.results.store import Entry, Store


def test_checking_a_lock_leaks_no_lock_into_a_forked_process(tmp_path, monkeypatch):
    """A fork shares the open file with its lock, as does a second descriptor of it, which is easier to be rid of."""
    store, one = Store(tmp_path / "runs"), Entry("sample", "sample/bunny", {"stage": "sample"}, {})
    flock, shared = fcntl.flock, []
    with store.lock(one):
        pass  # its file is there

    def sharing(file, how):
        flock(file, how)
        if how & fcntl.LOCK_SH:
            shared.append(os.dup(file.fileno()))

    monkeypatch.setattr(fcntl, "flock", sharing)
    try:
        assert not store.is_locked(one.stage, one.fingerprint[:32])
        (path,) = store.root.glob(".locks/**/*" + one.fingerprint[:32] + "*")
        with path.open("a+") as file:
            flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        assert len(shared) == 1
    finally:
        for descriptor in shared:
            os.close(descriptor)
