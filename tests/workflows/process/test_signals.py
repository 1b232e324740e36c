"""One wish to stop a task ends it once, however many signals bring it."""

from __future__ import annotations

import subprocess
import sys

CHILD = """
import multiprocessing, os, signal, time
from z2p_renderer.workflows.process import signals

def slow_log_line(line, log_line=signals.log_line):
    time.sleep(0.5)  # the second signal arrives meanwhile
    log_line(line)

def task(started):
    with signals.exit_on_interrupt("train"):
        started.set()
        time.sleep(30)

signals.log_line = slow_log_line
signals.handle_termination()
fork = multiprocessing.get_context("fork")
started = fork.Event()
child = fork.Process(target=task, args=[started])
child.start()
started.wait()
for sent in (signal.SIGINT, signal.SIGTERM):
    time.sleep(0.2)
    os.kill(child.pid, sent)
child.join()
print(child.exitcode)
"""


def test_a_second_signal_does_not_break_into_a_tasks_end():
    run = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, timeout=60, check=True)
    assert (run.stdout, run.stderr) == ("130\n", "train: interrupted\n")
