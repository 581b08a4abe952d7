"""Data in wrong units or missing: a `DataWarning` or a `FrameError`, never silence."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from conftest import WORLD, Walk, read

import cairn

Readings = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def inertial_walk() -> Walk:
    """Fourteen seconds with one camera and an IMU: readings in degrees show in what the walker's steps and turns do to gravity."""
    return read(WORLD.replace("rgbd", "mono-imu") + "&duration=14")


def doubts(walk: Walk, change: Callable[[Readings], Readings]) -> list[str]:
    """The warnings of a run whose readings are changed."""
    slam = cairn.Slam(walk.rig, rate_hz=10.0)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        for frame in walk.frames:
            readings = change(frame.imu.array.copy())
            slam.track(frame.image, imu=readings, stamp_ns=frame.stamp_ns)
        slam.finish()
        slam.finish()
    assert all(issubclass(w.category, cairn.DataWarning) and w.filename == __file__ for w in seen)
    return [str(w.message) for w in seen]


def scaled(columns: slice, factor: float) -> Callable[[Readings], Readings]:
    def change(readings: Readings) -> Readings:
        readings[:, columns] *= factor
        return readings

    return change


def test_an_imu_in_other_units_or_exchanged_warns_once(inertial_walk: Walk) -> None:
    assert doubts(inertial_walk, lambda readings: readings) == []
    (exchanged,) = doubts(inertial_walk, lambda r: r[:, [3, 4, 5, 0, 1, 2, 6]])
    assert "are they exchanged?" in exchanged
    (in_g,) = doubts(inertial_walk, scaled(slice(0, 3), 1 / 9.81))
    assert "is it in g?" in in_g
    (degrees,) = doubts(inertial_walk, scaled(slice(3, 6), 57.29578))
    assert "is it in degrees?" in degrees


def test_depth_in_metres_as_integers_is_refused(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig, "rgbd", rate_hz=10.0)
    frame = walk.frames[0]
    assert frame.depth is not None and walk.rig.depth_scale is not None
    metres = np.round(frame.depth * walk.rig.depth_scale).astype(np.uint16)
    with pytest.raises(cairn.FrameError, match="if it is in metres, give floats"):
        slam.track(frame.image, depth=metres, stamp_ns=frame.stamp_ns)
    # With its unit it is what it is, and the refused frame has not used up its time.
    output = slam.track(frame.image, depth=metres, depth_scale=1.0, stamp_ns=frame.stamp_ns)
    assert output.stamp_ns == frame.stamp_ns


def test_no_depth_in_rgbd_warns_once(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig, "rgbd", rate_hz=10.0)
    with pytest.warns(cairn.DataWarning, match="no image has depth") as seen:
        for frame in walk.frames:
            slam.track(frame.image, stamp_ns=frame.stamp_ns)
        slam.finish()
    assert len(seen) == 1
    # One camera alone needs none.
    slam = cairn.Slam(walk.rig, "mono", rate_hz=10.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for frame in walk.frames:
            slam.track(frame.image, stamp_ns=frame.stamp_ns)
        slam.finish()


def test_a_refused_frame_does_not_use_up_its_time(stereo_walk: Walk) -> None:
    slam = cairn.Slam(stereo_walk.rig, "stereo", rate_hz=10.0)
    frame = stereo_walk.frames[0]
    with pytest.raises(cairn.FrameError):
        slam.track(frame.image, stamp_ns=frame.stamp_ns)
    output = slam.track(frame.image, right=frame.right, stamp_ns=frame.stamp_ns)
    assert output.stamp_ns == frame.stamp_ns
