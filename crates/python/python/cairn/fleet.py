"""Many recorded walks into one atlas, over Ray (https://ray.io, PyPI `ray`): `cairn fleet build`, from Python.

>>> import cairn.fleet
>>> report = cairn.fleet.build("recordings", "store", workers=2)          # doctest: +SKIP
>>> report["atlases"], report["digest"]                                   # doctest: +SKIP

Recordings and store are folders that all workers reach, or `s3://BUCKET/PREFIX`. What is done is in the store: a build that
was stopped goes on where it was, and a task whose worker died is done again by another, with the same result to the byte.
"""

import argparse
import importlib
import json
import os
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

from cairn._cairn import FleetBuild, fleet_run

__all__ = ["build", "run_in_order"]

# Tasks that wait at Ray, at most; more only cost memory of the driver.
_WAITING = 1000
# A task is given up after it has taken so many workers down with it.
_DEATHS = 4

_Runner = Callable[[str, Sequence[str]], list[str]]


def build(
    recordings: str,
    out: str,
    *,
    config: str = "",
    overlap_m: float = 5.0,
    tile_m: float = 20.0,
    margin_m: float = 4.0,
    shards: int = 1,
    workers: int | None = None,
    address: str | None = None,
    ray: bool = True,
) -> dict[str, Any]:
    """Builds an atlas of all recordings below an address, and publishes it in a store.

    Args:
        recordings: Each folder, bag or video directly in this folder, or below s3://BUCKET/PREFIX, is one recording.
        out: The store: a folder, or s3://BUCKET/PREFIX.
        config: Entries of a configuration that differ from the defaults, as TOML.
        overlap_m: Two maps become one only where they overlap over this many metres: more than a room, which may have a copy.
        tile_m: Edge of the cubes into which the atlas is cut.
        margin_m: How far beyond its cube a tile has key frames.
        shards: Shards of the index of places.
        workers: Workers on this machine; by default one for each core.
        address: Of a Ray cluster in place of this machine.
        ray: Without it all is done in this process, one task after the other.

    Returns:
        What came of it: recordings, pairs, atlases, tiles, the digest of the whole, and what each step cost.

    Raises:
        Error: When a store cannot be reached.
        ImportError: When Ray is missing.
    """
    job = json.dumps(
        {
            "recordings": recordings,
            "store": out,
            "config": config,
            "overlap_m": overlap_m,
            "tile_m": tile_m,
            "margin_m": margin_m,
            "shards": shards,
        }
    )
    return _drive(job, _over_ray(workers, address) if ray else run_in_order)


def run_in_order(job: str, tasks: Sequence[str]) -> list[str]:
    """Does tasks of a build in this process, one after the other."""
    return [fleet_run(job, task) for task in tasks]


def _drive(job: str, run: _Runner) -> dict[str, Any]:
    state = FleetBuild(job)
    tasks = state.next([])
    while tasks:
        print(f"{json.loads(tasks[0])['step']}: {len(tasks)} tasks", file=sys.stderr, flush=True)
        tasks = state.next(run(job, tasks))
    report: dict[str, Any] = json.loads(state.report())
    return report


def _fleet_task(job: str, task: str) -> str:
    # Ray takes functions of Python only.
    return fleet_run(job, task)


def _over_ray(workers: int | None, address: str | None) -> _Runner:
    # Without its types, so that these are checked where Ray is not installed, too.
    ray: Any = importlib.import_module("ray")
    if not ray.is_initialized():
        # One core each: what Ray counts as a core is a worker here.
        ray.init(address=address, num_cpus=None if address else workers, include_dashboard=False, log_to_driver=False)
    remote: Any = ray.remote(num_cpus=1, max_retries=_DEATHS - 1)(_fleet_task)

    def run(job: str, tasks: Sequence[str]) -> list[str]:
        outcomes = [""] * len(tasks)
        waiting: dict[Any, int] = {}
        given = 0
        while given < len(tasks) or waiting:
            while given < len(tasks) and len(waiting) < _WAITING:
                waiting[remote.remote(job, tasks[given])] = given
                given += 1
            done, _ = ray.wait(list(waiting), num_returns=1)
            for reference in done:
                place = waiting.pop(reference)
                try:
                    outcomes[place] = ray.get(reference)
                except ray.exceptions.WorkerCrashedError as death:
                    outcomes[place] = _deadly(tasks[place], death)
        return outcomes

    return run


def _deadly(task: str, death: Exception) -> str:
    """The outcome of a recording that no worker survives; any other task that does that ends the build."""
    if json.loads(task)["step"] != "map":
        raise death
    why = f"{_DEATHS} workers died of it, the last with: {death}".split("\n")[0]
    result = {"result": "unmapped", "why": why}
    return json.dumps(
        {"key": None, "reused": False, "seconds": 0.0, "read_bytes": 0, "written_bytes": 0, "result": result}
    )


def _end_with_input() -> None:
    """Ends this process at once when its standard input does: whoever started it is gone. What Ray started here ends with it."""
    sys.stdin.buffer.read()
    print("fleet: ended, as the program that started it did", file=sys.stderr, flush=True)
    os._exit(1)


def main() -> None:
    """What `cairn fleet build` starts: progress on stderr, the report as one line of JSON on stdout."""
    threading.Thread(target=_end_with_input, daemon=True).start()
    parser = argparse.ArgumentParser(prog="python -m cairn.fleet", description="Use cairn fleet build, or cairn.fleet.build.")
    parser.add_argument("--job", required=True, help="the job as JSON")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--ray", help="the address of a Ray cluster")
    given = parser.parse_args()
    report = _drive(given.job, _over_ray(given.workers, given.ray))
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
