"""A run shown while it happens: the program rerun of rerun-sdk listens, as the viewer does, and keeps what comes in a file."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from postcard import END, at, begin, show, words
from test_run import CAIRN, tum
from viewer import Recording

CAIRN_RERUN = os.environ["CAIRN_RERUN"]


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(condition, seconds=20.0):
    end = time.time() + seconds
    while time.time() < end:
        if condition():
            return True
        time.sleep(0.05)
    return bool(condition())


class Viewer:
    """The receiving side of rerun, without a window."""

    def __init__(self, path):
        self.path, self.port = path, free_port()
        program = shutil.which("rerun", path=Path(sys.executable).parent)
        command = [program, "--save", path, "--bind", "127.0.0.1", "--port", str(self.port)]
        # A group of its own: the program starts another one, which would go on without it.
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.child = subprocess.Popen(command, start_new_session=True, **quiet)
        assert until(self.listens), "rerun does not listen"
        self.address = f"rerun+http://127.0.0.1:{self.port}/proxy"

    def listens(self):
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def size(self):
        return self.path.stat().st_size if self.path.exists() else 0

    def end(self):
        for how in (signal.SIGINT, signal.SIGKILL):
            try:
                os.killpg(self.child.pid, how)
                self.child.wait(10)
            except ProcessLookupError:
                return
            except subprocess.TimeoutExpired:
                pass


@pytest.fixture
def viewer(tmp_path):
    viewer = Viewer(tmp_path / "seen.rrd")
    yield viewer
    viewer.end()


def test_a_run_is_seen_as_it_was(viewer, tmp_path):
    world = "sim:demo?sensor=rgbd&resolution=320x240&duration=4"
    command = [CAIRN, "run", world, "--rerun", viewer.address, "--live-trajectory", tmp_path / "live.tum"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    stamps, positions, _ = tum(tmp_path / "live.tum")
    # What is left is written some moments after it came.
    size = lambda: (viewer.size(), time.sleep(0.5), viewer.size())  # noqa: E731
    assert until(lambda: (lambda s: s[0] == s[2] > 100_000)(size())), viewer.size()
    viewer.end()
    recording = Recording(viewer.path)
    shown = recording.column("/map0/body", "translation")
    assert [t for t, _ in shown] == stamps.tolist() and len(stamps) > 20
    assert np.allclose([v[0] for _, v in shown], positions, atol=1e-5)
    assert len(recording.column("/map0/cam0/image", "buffer")) > 10
    recording.close()
    assert not (tmp_path / "rerun+http:").exists(), "an address is no file"


def test_what_is_shown_is_there_before_the_run_ends(viewer):
    program = subprocess.Popen([CAIRN_RERUN, viewer.address], stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    program.stdin.write(begin("a walk") + at(5, 0) + show("said", *words(False, "hello")))
    program.stdin.flush()
    assert until(lambda: viewer.path.exists() and b"hello" in viewer.path.read_bytes()), viewer.size()
    assert program.poll() is None
    program.stdin.write(END)
    program.stdin.close()
    assert program.wait(30) == 0, program.stderr.read()


def test_a_viewer_that_is_not_there_is_told_at_once(tmp_path):
    address = f"rerun+http://127.0.0.1:{free_port()}/proxy"
    began = time.time()
    done = subprocess.run([CAIRN_RERUN, address], input=begin("x") + END, capture_output=True, timeout=60)
    assert done.returncode == 1 and b"no viewer listens" in done.stderr and time.time() - began < 10, done.stderr
    short = "sim:demo?sensor=rgbd&resolution=320x240&duration=1"
    done = subprocess.run([CAIRN, "run", short, "--rerun", address], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "no viewer listens" in done.stderr and "start the viewer first" in done.stderr, done.stderr
