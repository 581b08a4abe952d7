"""What the Python bindings cost a frame, against the Rust program.

    target/python/bin/python tools/measure_python.py SOURCE [--frames N] [--repeat R] [--program target/release/cairn]

Two measurements of the same frames in lockstep:

inside     Of each call of `Slam.track` with numpy arrays, the wall time outside of the engine: checking and copying the
           arrays, giving the interpreter away and taking it back, building the result. Measured in one process, so that
           the noise of the machine is in both; the median over the frames.
program    Processor time a frame of this whole process (reading, tracking, mapping, the last adjustment) against that of
           `cairn run` on the same source. Start-up is subtracted by a second run of a few frames. The runs alternate; the
           smallest of each is compared, for what is more than that is the noise of the machine.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

FEW = 20


def play(source_name: str, frames: int) -> list[tuple[float, float]]:
    """Tracks a source by arrays; of each frame the milliseconds of the call and of the engine in it."""
    import cairn

    source = cairn.open(source_name, frames=frames)
    slam = cairn.Slam.for_source(source)
    times: list[tuple[float, float]] = []
    for frame in source:
        image, right, depth, imu = frame.image, frame.right, frame.depth, frame.imu
        stamp_ns = frame.stamp_ns
        began = time.perf_counter()
        output = slam.track(image, depth=depth, right=right, imu=imu, stamp_ns=stamp_ns)
        pose = output.world_from_body
        ended = time.perf_counter()
        del pose
        times.append((1e3 * (ended - began), output.step_ms))
    slam.finish()
    return times


def processor_s(command: list[str]) -> float:
    """User and system seconds of a command that must succeed."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    words = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"{' '.join(command)}: {words.decode()}")
    return used.ru_utime + used.ru_stime


def median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--program", type=Path, default=Path("target/release/cairn"))
    parser.add_argument("--play", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.play:
        play(given.source, given.frames)
        return

    outside: list[float] = []
    share: list[float] = []
    for _ in range(given.repeat):
        times = play(given.source, given.frames)[FEW:]
        outside.append(median([call - engine for call, engine in times]))
        share.append(sum(call - engine for call, engine in times) / sum(engine for _, engine in times))
        step = median([engine for _, engine in times])
    print(f"inside     {1e3 * min(outside):.0f} us a frame outside of the engine (median of the frames), the step "
          f"{step:.2f} ms; over all frames {100 * median(share):.2f} % (median of {given.repeat} runs)")

    if not given.program.exists():
        print(f"skipped: {given.program} is not built")
        return

    def python(frames: int) -> list[str]:
        return [sys.executable, __file__, given.source, "--play", "--frames", str(frames)]

    def program(frames: int) -> list[str]:
        return [str(given.program), "run", given.source, "--frames", str(frames)]

    used: dict[tuple[str, int], list[float]] = {}
    for _ in range(given.repeat):
        for frames in (FEW, given.frames):
            used.setdefault(("rust", frames), []).append(processor_s(program(frames)))
            used.setdefault(("python", frames), []).append(processor_s(python(frames)))
    per = {
        which: 1e3 * (min(used[which, given.frames]) - min(used[which, FEW])) / (given.frames - FEW)
        for which in ("rust", "python")
    }
    print(f"program    {per['python']:.2f} ms of processor time a frame, the program {per['rust']:.2f} ms: "
          f"{100 * (per['python'] / per['rust'] - 1):+.1f} %")


if __name__ == "__main__":
    main()
