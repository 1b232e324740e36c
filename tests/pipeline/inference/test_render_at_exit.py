"""Pictures drawn while Python ends, and in processes forked off one that has drawn: the same ones, and not a word."""

import subprocess
import sys

import pytest

START = """
import atexit, hashlib, os, signal, sys, threading, time, warnings
import numpy as np
import z2p_core
warnings.simplefilter("ignore")
signal.alarm(60)
points = np.random.default_rng(0).normal(size=(3000, 3))
def draw():
    os.write(1, (hashlib.sha256(z2p_core.render(points, size=96).array.tobytes()).hexdigest() + "\\n").encode())
"""
SCRIPTS = {
    "a thread that outlives the main thread": """
draw()
threading.Thread(target=lambda: (threading.main_thread().join(), draw())).start()
""",
    "such a thread that is the first to draw": """
threading.Thread(target=lambda: (threading.main_thread().join(), draw(), draw())).start()
""",
    "at exit": "draw(); atexit.register(draw)",
    "at exit for the first time": "atexit.register(draw); atexit.register(draw)",
    "no thread left": """
draw()
def none(self): raise RuntimeError("can't start new thread")
z2p_core.parallel._second_core.cache_clear()
threading.Thread.start = none
draw()
""",
    "a fork that ends as scripts do": """
draw()
child = os.fork()
if not child:
    draw()
    sys.exit(0)
sys.exit(os.waitpid(child, 0)[1])
""",
}


def run(script: str) -> tuple[int, list[str], str]:
    done = subprocess.run([sys.executable, "-c", START + script], capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout.split(), done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("where", SCRIPTS)
def test_pictures_are_the_same_wherever_they_are_drawn(where):
    status, pictures, words = run(SCRIPTS[where])
    assert (status, words) == (0, "")
    assert len(pictures) == 2 and len(set(pictures)) == 1
    assert pictures[0] == usual_picture()


@pytest.mark.slow
def test_a_thread_that_goes_with_python_makes_no_noise():
    status, pictures, words = run("""
draw()
def work():
    while True: z2p_core.render(points, size=96)
threading.Thread(target=work, daemon=True).start()
time.sleep(0.2)
""")
    assert (status, pictures, words) == (0, [usual_picture()], "")


def usual_picture() -> str:
    import hashlib

    import numpy as np

    import z2p_core

    points = np.random.default_rng(0).normal(size=(3000, 3))
    return hashlib.sha256(z2p_core.render(points, size=96).array.tobytes()).hexdigest()
