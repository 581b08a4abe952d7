"""Threads, processes, and Ctrl-C."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from conftest import WORLD, Walk, as_they_are, digest

import cairn

SHORT = WORLD + "&duration=1"


def test_other_threads_run_while_a_frame_is_tracked(walk: Walk) -> None:
    ticks: list[float] = []
    done = threading.Event()

    def tick() -> None:
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.0002)

    slam = cairn.Slam(walk.rig)
    thread = threading.Thread(target=tick)
    # Without this, a thread that waits for the interpreter asks for it only after 5 ms.
    before = sys.getswitchinterval()
    sys.setswitchinterval(10.0)
    thread.start()
    try:
        during = 0
        for frame in walk.frames:
            began = time.perf_counter()
            slam.track(frame)
            ended = time.perf_counter()
            during += sum(began < t < ended for t in ticks)
    finally:
        done.set()
        thread.join()
        sys.setswitchinterval(before)
    # Nobody asks the main thread for the interpreter within 10 s: it must have given it away by itself.
    assert during > len(walk.frames)


def test_each_thread_has_its_own_slam(walk: Walk) -> None:
    expected = digest(walk, as_they_are)
    with ThreadPoolExecutor(4) as pool:
        digests = list(pool.map(lambda _: digest(walk, as_they_are), range(6)))
    assert digests == [expected] * 6


def test_threads_may_share_one_slam(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig)
    refused: list[str] = []
    stop = threading.Event()

    def look() -> None:
        while not stop.is_set():
            points = slam.map.points()
            assert points.shape[1] == 3
            list(slam.events())
            slam.heard()
            repr(slam)

    def feed(frames: list[cairn.Frame]) -> int:
        tracked = 0
        for frame in frames:
            try:
                slam.track(frame)
                tracked += 1
            except cairn.FrameError as error:
                refused.append(str(error))
        return tracked

    looking = [threading.Thread(target=look) for _ in range(2)]
    for thread in looking:
        thread.start()
    with ThreadPoolExecutor(3) as pool:
        tracked = sum(pool.map(feed, [walk.frames] * 3))
    stop.set()
    for thread in looking:
        thread.join()
    # Each time is taken once at most; what comes late is refused with its reason.
    assert 1 <= tracked <= len(walk.frames) and tracked + len(refused) == 3 * len(walk.frames)
    assert all("not later" in words for words in refused)


def test_threads_share_the_frames_of_a_source() -> None:
    source = cairn.open(SHORT)
    with ThreadPoolExecutor(3) as pool:
        parts = list(pool.map(lambda _: [f.stamp_ns for f in source], range(3)))
    assert sorted(sum(parts, [])) == [f.stamp_ns for f in cairn.open(SHORT)]


def run(address: str) -> int:
    """Runs in another process; what it needs is pickled."""
    source = cairn.open(address)
    slam = cairn.Slam(source.rig, config=cairn.Config(), rate_hz=10.0)
    for frame in source:
        slam.track(frame)
    return slam.digest


def run_rig(rig: cairn.Rig) -> int:
    slam = cairn.Slam(rig, rate_hz=10.0)
    for frame in cairn.open(SHORT):
        slam.track(frame)
    return slam.digest


@pytest.mark.parametrize("method", ["spawn", "fork", "forkserver"])
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_processes_give_the_same_bits(method: str) -> None:
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system has no {method}")
    source = cairn.open(SHORT)
    expected = run(SHORT)
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map_async(run, [SHORT] * 2).get(60) == [expected] * 2
        assert pool.map_async(run_rig, [source.rig]).get(60) == [expected]


def use(source: cairn.Source, slam: cairn.Slam, to: multiprocessing.SimpleQueue[str]) -> None:
    for call in (lambda: next(source), lambda: slam.map):
        try:
            call()
            to.put("no exception")
        except cairn.Error as error:
            to.put(str(error))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_what_a_fork_has_inherited_says_so(walk: Walk) -> None:
    # Threads do not survive a fork: without a check the child would wait for ever.
    context = multiprocessing.get_context("fork")
    answers: multiprocessing.SimpleQueue[str] = context.SimpleQueue()
    source, slam = cairn.open(SHORT), cairn.Slam(walk.rig, threaded=True)
    slam.track(walk.frames[0])
    child = context.Process(target=use, args=(source, slam, answers))
    child.start()
    child.join(30)
    assert child.exitcode == 0
    assert "another process" in answers.get() and "another process" in answers.get()
    # The parent's are as they were.
    assert next(source).stamp_ns == 1_000_000_000
    slam.track(walk.frames[1])


def interrupted(code: str, after: str) -> float:
    """Starts a program, sends SIGINT once it has printed `after`; returns seconds until it ended by KeyboardInterrupt."""
    command = [sys.executable, "-c", textwrap.dedent(code)]
    program = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert program.stdout is not None and program.stderr is not None
    assert program.stdout.readline().strip() == after, program.stderr.read()
    time.sleep(0.3)
    # As a terminal does: to all processes of the group.
    os.killpg(program.pid, signal.SIGINT)
    began = time.perf_counter()
    try:
        _, words = program.communicate(timeout=20)
    except subprocess.TimeoutExpired:
        os.killpg(program.pid, signal.SIGKILL)
        raise
    ended = time.perf_counter() - began
    assert "KeyboardInterrupt" in words and program.returncode != 0, words
    return ended


def test_ctrl_c_ends_a_loop_of_frames() -> None:
    code = f"""
    import cairn
    frames = list(cairn.open({SHORT!r}))
    rig = cairn.open({SHORT!r}).rig
    print("ready", flush=True)
    while True:
        slam = cairn.Slam(rig)
        for frame in frames:
            slam.track(frame)
    """
    assert interrupted(code, "ready") < 5.0


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="skipped: live streams need ffmpeg")
def test_ctrl_c_ends_the_waiting_for_a_frame() -> None:
    # Nobody ever sends a picture there.
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    code = f"""
    import cairn
    rig = cairn.Rig(cairn.Camera(640, 480, 500.0, 500.0, 319.5, 239.5))
    print("ready", flush=True)
    source = cairn.open("rtmp-listen://127.0.0.1:{port}/cairn", rig=rig)
    next(source)
    """
    assert interrupted(code, "ready") < 5.0


def test_ctrl_c_ends_the_opening_of_a_source() -> None:
    # This world takes a quarter of a minute to build.
    code = """
    import cairn
    print("ready", flush=True)
    cairn.open("sim:demo?detail=4")
    """
    assert interrupted(code, "ready") < 5.0


def test_ctrl_c_ends_the_waiting_for_the_last_adjustment() -> None:
    def walked() -> cairn.Slam:
        # One camera, whose map is adjusted as a whole at the end.
        source = cairn.open("sim:office?sensor=mono&resolution=400x300&focal=260&rate=15&duration=60")
        slam = cairn.Slam.for_source(source)
        for frame in source:
            slam.track(frame)
        return slam

    slam, same = walked(), walked()
    began = time.perf_counter()
    same.finish()
    took = time.perf_counter() - began
    assert took > 0.08, f"{took} s are too short to be interrupted"
    timer = threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    began = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        slam.finish()
    left = time.perf_counter()
    timer.join()
    # The adjustment goes on to its end; the next call waits for it.
    assert len(slam.trajectory()) > 100
    ended = time.perf_counter()
    print(f"an adjustment of {took:.2f} s was left after {left - began:.2f} s, and ended after {ended - began:.2f} s")
    assert left < ended - 0.01
