"""What the tests of fleet builds share: recordings, the program, the processes of Ray, a server that speaks S3."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CAIRN = os.environ.get("CAIRN", "cairn")
WALKS = ["start=0&height=1.3", "start=2&speed=1.0&height=1.4", "start=1&speed=1.1&height=1.2"]


def record(to: Path, world: str) -> None:
    options = "sensor=rgbd&resolution=320x240&focal=210&rate=10"
    subprocess.run([CAIRN, "sim", f"{world}&{options}", "--out", str(to)], check=True, capture_output=True)


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three walks each of three houses."""
    folder = tmp_path_factory.mktemp("recordings")
    for seed in (11, 12, 13):
        for n, options in enumerate(WALKS):
            record(folder / f"house{seed}-{n}", f"demo?seed={seed}&duration=8&{options}")
    return folder


def arguments(source: object, store: object, *more: str) -> list[str]:
    return [CAIRN, "fleet", "build", str(source), "--out", str(store), "--overlap", "2", "--tile", "4", "--margin", "1", "--json", *more]


def build(source: object, store: object, *more: str) -> dict[str, Any]:
    done = subprocess.run(arguments(source, store, *more), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def children(pid: int) -> dict[int, str]:
    """All processes below one, with the names that they gave themselves."""
    parents: dict[int, tuple[int, str]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            parents[int(entry.name)] = (int(stat.rsplit(")", 1)[1].split()[1]), line)
    found: dict[int, str] = {}
    more = [pid]
    while more:
        above = more.pop()
        below = [child for child, (parent, _) in parents.items() if parent == above]
        found.update({child: parents[child][1] for child in below})
        more.extend(below)
    return found


def kill_a_worker(driver: int, patience_s: float = 60.0) -> int:
    """Kills, at once and unasked, a worker that is doing a task."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        for pid, line in children(driver).items():
            # Ray's name of a worker at work is its task.
            if line.startswith("ray::_fleet_task"):
                os.kill(pid, signal.SIGKILL)
                return pid
        time.sleep(0.005)
    raise AssertionError("no worker was seen at work")


@pytest.fixture(scope="session")
def s3() -> Iterator[Any]:
    """A server that speaks S3, with a bucket; a client of it."""
    import boto3

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    endpoint = f"http://127.0.0.1:{port}"
    os.environ.update(
        AWS_ACCESS_KEY_ID="test",
        AWS_SECRET_ACCESS_KEY="test",
        AWS_REGION="us-east-1",
        AWS_ENDPOINT=endpoint,
        AWS_ALLOW_HTTP="true",
    )
    client = boto3.client("s3", endpoint_url=endpoint, region_name="us-east-1")
    for _ in range(100):
        try:
            client.create_bucket(Bucket="walks")
            break
        except Exception:
            time.sleep(0.2)
    yield client
    server.terminate()
    server.wait()
