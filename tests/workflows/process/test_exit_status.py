"""A run that fails ends with one line, and a status that says whether to try again; whichever process it failed in."""

import multiprocessing

import luigi.retcodes
import pytest

from z2p_renderer.storage.files.disk_errors import TEMPORARY_FAILURE
from z2p_renderer.workflows.process import exit_status


@pytest.fixture(autouse=True)
def statuses(monkeypatch):
    """The object with luigi's exit statuses, as they were; nothing is left in the pipe."""
    found = luigi.retcodes.retcode()
    before = found.task_failed, found.scheduling_error
    exit_status._read_failures()
    yield found
    found.task_failed, found.scheduling_error = before
    exit_status._read_failures()


def in_a_fork(*calls) -> None:
    def work():
        for line, passing in calls:
            exit_status.record_failure(line, temporary=passing)

    child = multiprocessing.get_context("fork").Process(target=work)
    child.start()
    child.join()


def test_nothing_failed():
    assert not exit_status.summarize_failures()


def test_what_may_pass_ends_with_a_status_of_its_own(statuses):
    in_a_fork(("FAILED train: no space left", True))
    assert exit_status.summarize_failures() and statuses.task_failed == statuses.scheduling_error == TEMPORARY_FAILURE
    assert not exit_status.summarize_failures(), "and it is told once"


def test_what_fails_again_keeps_its_status(statuses, capfd):
    in_a_fork(("FAILED train: no space left", True), ("FAILED render: Blender exited with 1", False))
    assert exit_status.summarize_failures() and statuses.task_failed != TEMPORARY_FAILURE
    assert capfd.readouterr().err.splitlines()[-1] == "FAILED 2 tasks, the first: train: no space left"


def test_thousands_of_failures_and_endless_lines_block_nobody():
    in_a_fork(*[("FAILED " + "x" * 10_000, False)] * 100)
    assert exit_status.summarize_failures()


def test_the_reason_of_a_failure_is_the_last_line(capfd):
    exit_status.record_failure("FAILED train: no shards")
    assert exit_status.summarize_failures() and capfd.readouterr().err.splitlines() == ["FAILED train: no shards"]
    in_a_fork(("FAILED train: no shards", False))
    exit_status.log_line("render: done")
    assert exit_status.summarize_failures()
    assert capfd.readouterr().err.splitlines() == ["FAILED train: no shards", "render: done", "FAILED train: no shards"]
