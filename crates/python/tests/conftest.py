"""Walks and recordings that the tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

import cairn

REPOSITORY = Path(__file__).resolve().parents[3]
WORLD = "sim:demo?sensor=rgbd&resolution=320x240&rate=10&detail=0.3"
"""A walk with a depth camera through a small world: a frame takes about four milliseconds."""


@dataclass
class Walk:
    """The frames of a source, read once."""

    rig: cairn.Rig
    frames: list[cairn.Frame]
    truth: cairn.Trajectory


def read(address: str) -> Walk:
    source = cairn.open(address)
    truth = source.truth
    assert truth is not None
    return Walk(source.rig, list(source), truth)


@pytest.fixture(scope="session")
def walk() -> Walk:
    """Two seconds with a depth camera."""
    return read(WORLD + "&duration=2")


@pytest.fixture(scope="session")
def long_walk() -> Walk:
    """Six seconds with a depth camera."""
    return read(WORLD + "&duration=6")


@pytest.fixture(scope="session")
def stereo_walk() -> Walk:
    """A second with two cameras and an IMU."""
    return read(WORLD.replace("rgbd", "stereo-imu") + "&duration=1")


Feed = Callable[[cairn.Slam, int, cairn.Frame], cairn.Output]


def digest(walk: Walk, feed: Feed) -> int:
    """The digest of a run in which each frame is given by `feed`."""
    slam = cairn.Slam(walk.rig, rate_hz=10.0)
    for number, frame in enumerate(walk.frames):
        output = feed(slam, number, frame)
        assert output.stamp_ns == frame.stamp_ns
    assert slam.map.key_frame_count > 0
    return slam.digest


def as_they_are(slam: cairn.Slam, _: int, frame: cairn.Frame) -> cairn.Output:
    return slam.track(frame)


def recording(name: str) -> Path:
    """The folder of a recording; skips the test, aloud, where there is none."""
    folder = Path(os.environ.get("CAIRN_DATA", REPOSITORY.parent / "shared" / "data")) / name
    if not folder.is_dir():
        print(f"skipped: there is no recording in {folder}")
        pytest.skip(f"there is no recording in {folder}")
    return folder
