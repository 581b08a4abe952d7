"""Calibrations: made, read, written, refused, pickled."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cairn


def camera(**other: Any) -> cairn.Camera:
    return cairn.Camera(640, 480, 500.0, 501.0, 319.5, 239.5, **other)


def at(x: float) -> np.ndarray[Any, Any]:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


RIGS = {
    "mono": lambda: cairn.Rig(camera()),
    "stereo": lambda: cairn.Rig([camera(name="left"), camera(name="right", body_from_camera=at(0.12))]),
    "rgbd": lambda: cairn.Rig(camera(), depth_scale=0.001),
    "rgbd, own camera": lambda: cairn.Rig(
        camera(), depth_scale=0.001, depth_camera=camera(body_from_camera=at(0.03))
    ),
    "fisheye, IMU": lambda: cairn.Rig(
        camera(distortion="equidistant", coefficients=[0.01, 0.0, 0.0, 0.0]), imu=cairn.Imu(rate_hz=400.0)
    ),
}


@pytest.mark.parametrize("kind", RIGS)
def test_rigs_survive_pickling_and_files(kind: str, tmp_path: Path) -> None:
    rig = RIGS[kind]()
    assert pickle.loads(pickle.dumps(rig)) == rig
    rig.save(tmp_path / "rig.toml")
    assert cairn.Rig.load(tmp_path / "rig.toml") == rig
    assert (tmp_path / "rig.toml").read_text() == rig.to_toml()


def test_lenses_take_their_coefficients() -> None:
    for name, count in [
        ("none", 0),
        ("radial-tangential", 4),
        ("radial-tangential", 5),
        ("rational", 8),
        ("inverse-radial-tangential", 5),
        ("equidistant", 4),
        ("fov", 1),
        ("double-sphere", 2),
    ]:
        made = camera(distortion=name, coefficients=[0.1] * count)
        assert made.distortion == name and made.coefficients[:count] == [0.1] * count
        assert pickle.loads(pickle.dumps(made)) == made
        with pytest.raises(cairn.RigError, match="coefficients"):
            camera(distortion=name, coefficients=[0.1] * (count + 9))


def test_impossible_rigs_say_which_number() -> None:
    far, sheared, flat = at(100.0), np.eye(4), np.eye(4)
    sheared[0, 1] = 0.5
    flat[3, 3] = 0.0
    cases: list[tuple[str, Callable[[], object]]] = [
        ("focal", lambda: cairn.Camera(640, 480, -1.0, 1.0, 0.0, 0.0)),
        ("fx is NaN", lambda: cairn.Camera(640, 480, float("nan"), 1.0, 0.0, 0.0)),
        ("resolution", lambda: cairn.Camera(0, 480, 1.0, 1.0, 0.0, 0.0)),
        ("at most", lambda: cairn.Camera(2**31, 480, 1.0, 1.0, 0.0, 0.0)),
        ("principal", lambda: cairn.Camera(640, 480, 500.0, 500.0, 1e9, 0.0)),
        ("not known", lambda: camera(distortion="magic")),
        ("not finite", lambda: camera(body_from_camera=np.full((4, 4), np.nan))),
        ("rotation", lambda: camera(body_from_camera=sheared)),
        ("last row", lambda: camera(body_from_camera=flat)),
        ("4x4", lambda: camera(body_from_camera=np.eye(3))),
        ("no camera", lambda: cairn.Rig([])),
        ("metres", lambda: cairn.Rig(camera(body_from_camera=far))),
        ("baseline", lambda: cairn.Rig([camera(), camera()])),
        ("metres per unit", lambda: cairn.Rig(camera(), depth_scale=0.0)),
        ("depth_scale", lambda: cairn.Rig(camera(), depth_camera=camera())),
        ("impossible", lambda: cairn.Rig(camera(), imu=cairn.Imu(gyro_noise=100.0))),
        ("rate", lambda: cairn.Rig(camera(), imu=cairn.Imu(rate_hz=0.0))),
    ]
    for words, make in cases:
        with pytest.raises(ValueError, match=words):
            make()


def test_files_that_are_no_rig_say_why(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("[[cameras]]\nwidth = 3\n")
    for path in (file, tmp_path / "none.toml", tmp_path):
        with pytest.raises(cairn.SourceError, match="rig|none|holds"):
            cairn.Rig.load(path)
    with pytest.raises(OSError, match="no-such"):
        cairn.Rig(camera()).save(tmp_path / "no-such" / "rig.toml")


def test_unusual_numbers_are_told() -> None:
    assert cairn.Rig(camera(), imu=cairn.Imu(rate_hz=50.0)).doubts


def test_trajectories_are_read_and_written(tmp_path: Path) -> None:
    poses = np.stack([at(0.0), at(1.0), at(3.0)])
    path = cairn.Trajectory(poses, stamps=[0.0, 0.1, 0.2])
    np.testing.assert_array_equal(path.poses, poses)
    np.testing.assert_allclose(path.stamps, [0.0, 0.1, 0.2])
    assert path.length_m == 3.0 and path.quaternions.tolist() == [[0, 0, 0, 1]] * 3
    for form in ("tum", "kitti", "euroc"):
        path.save(tmp_path / f"path.{form}", format=form)
        again = cairn.Trajectory.load(tmp_path / f"path.{form}")
        np.testing.assert_allclose(again.positions, path.positions, atol=1e-9)
    with pytest.raises(ValueError, match="3 poses and 2 times"):
        cairn.Trajectory(poses, stamps=[0.0, 0.1])
    with pytest.raises(ValueError, match="format"):
        path.save(tmp_path / "x", format="csv")  # type: ignore[arg-type]
    with pytest.raises(cairn.Error):
        cairn.Trajectory.load(tmp_path / "none")
