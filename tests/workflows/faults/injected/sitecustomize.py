"""Real faults at chosen moments: every Python process of a pipeline imports this when its folder is on the path.

``Z2P_FAULT="ACTION EVENT COUNT PATTERN"``: when the audit event ("open", "os.mkdir", "os.rename") happens for the
COUNTth time in a process with a path that PATTERN matches, ``kill`` kills the whole process group, ``die`` this process
alone, ``pause`` holds it up until a signal comes, and ``fill`` fills the filesystem of ``Z2P_BALLAST`` to the last byte
and goes on.
"""

import os
import re
import signal
import sys
import time

if "Z2P_FAULT" in os.environ:
    action, event, count, pattern = os.environ["Z2P_FAULT"].split(" ", 3)
    left = int(count)
    wanted = re.compile(pattern)

    def fill() -> None:
        path = os.environ["Z2P_BALLAST"]
        if os.path.exists(path):  # noqa: PTH110 - as little as possible is imported here
            return
        ballast = os.open(path, os.O_WRONLY | os.O_CREAT)
        try:
            for size in (1 << 20, 1 << 12, 1):
                try:
                    while True:
                        os.write(ballast, bytes(size))
                except OSError:
                    continue
        finally:
            os.close(ballast)

    def hook(name: str, arguments: tuple) -> None:
        global left
        if name != event or left == 0:
            return
        if any(isinstance(one, str | os.PathLike) and wanted.search(os.fspath(one)) for one in arguments):
            left -= 1
            if left == 0:
                if action == "kill":
                    os.killpg(os.getpgrp(), signal.SIGKILL)
                elif action == "die":
                    os.kill(os.getpid(), signal.SIGKILL)
                elif action == "pause":
                    time.sleep(300)
                else:
                    fill()

    sys.addaudithook(hook)
