"""Poses, states, the map, its events; saving, loading, relocalising."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import REPOSITORY, WORLD, Walk, as_they_are, digest, recording

import cairn

Matrix = npt.NDArray[np.float64]


def rotation(q: Matrix) -> Matrix:
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_poses_are_matrices_and_quaternions(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig, "rgbd", rate_hz=10.0)
    outputs = [slam.track(frame) for frame in walk.frames]
    output = outputs[-1]
    pose, q, p = output.world_from_body, output.quaternion, output.position
    assert pose is not None and q is not None and p is not None
    assert pose.shape == (4, 4) and pose.dtype == np.float64
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation(q), pose[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(p, pose[:3, 3])
    np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])
    assert output.metric and isinstance(output.state, cairn.Tracking)
    assert output.evidence.inliers > 100 and output.keypoints.shape == (output.evidence.features, 2)
    first, covariance = outputs[0].covariance, output.covariance
    assert first is not None and covariance is not None and not first.any(), "the first frame is where the map begins"
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9)
    # A millimetre, and a milliradian, about.
    sigmas = np.sqrt(np.linalg.eigvalsh(covariance))
    assert covariance.shape == (6, 6) and 1e-5 < sigmas.min() and sigmas.max() < 2e-2, sigmas
    path = slam.live_trajectory()
    np.testing.assert_array_equal(path.poses[-1], pose)
    assert path.stamps_ns.tolist() == [f.stamp_ns for f in walk.frames]
    # The walk of the truth, in its own frame.
    error = slam.accuracy(walk.truth)
    assert error.coverage is not None and error.coverage > 0.9
    assert error.ate_rmse_m < 0.03 and error.reference_covered > 0.9 and error.scale == 1.0


def test_states_have_their_numbers(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig)
    dark = np.zeros((240, 320), np.uint8)
    starting = slam.track(dark, depth=walk.frames[0].depth, stamp_ns=-1).state
    match starting:
        case cairn.Starting(have, need):
            assert have == 0 and need > 0
        case _:
            pytest.fail(f"{starting}")
    for frame in walk.frames:
        slam.track(frame)
    lost = slam.track(dark, depth=walk.frames[0].depth, stamp=100.0)
    match lost.state:
        case cairn.Lost(inliers, need):
            assert 0 <= inliers < need
        case _:
            pytest.fail(f"{lost.state}")
    assert lost.world_from_body is None and lost.position is None and lost.scale is None and lost.covariance is None
    assert lost.phase == "LOST" and lost.words


def test_map_is_arrays(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig)
    assert slam.map.points().shape == (0, 3) and slam.map.maps == []
    for frame in walk.frames:
        slam.track(frame)
    earlier = slam.map
    slam.finish()
    now = slam.map
    assert now.version > earlier.version
    points, landmarks, key_frames = now.points(), now.landmarks(), now.key_frames()
    assert points.shape == (now.landmark_count, 3) == (len(landmarks), 3)
    np.testing.assert_array_equal(points, landmarks.positions)
    np.testing.assert_allclose(np.linalg.norm(landmarks.normals, axis=1), 1.0, atol=1e-9)
    assert landmarks.observations.min() >= 1 and landmarks.descriptors.shape == (len(landmarks), 32)
    assert key_frames.poses.shape == (now.key_frame_count, 4, 4) == (len(key_frames.ids), 4, 4)
    np.testing.assert_array_equal(key_frames.poses[:, :3, 3], key_frames.positions)
    assert len(now.trajectory()) == now.key_frame_count and now.is_metric(now.maps[0])
    with pytest.raises(KeyError, match="no map 77"):
        now.points(77)
    # Arrays are the caller's own.
    points[...] = 0
    assert now.points().any()


def test_two_runs_and_the_program_give_the_same_poses(walk: Walk, tmp_path: Path) -> None:
    assert digest(walk, as_they_are) == digest(walk, as_they_are)
    program = REPOSITORY / "target/release/cairn"
    if not program.exists():
        print(f"skipped: {program} is not built")
        pytest.skip("the program is not built")
    address = WORLD + "&duration=2"
    arguments: list[str | Path] = [program, "run", address, "--trajectory", tmp_path / "program.txt"]
    subprocess.run(arguments, check=True, capture_output=True)
    source = cairn.open(address)
    slam = cairn.Slam.for_source(source)
    for frame in source:
        slam.track(frame)
    slam.finish()
    slam.trajectory().save(tmp_path / "python.txt")

    def poses(name: str) -> list[str]:
        lines = (tmp_path / name).read_text().splitlines()
        # Only the program says before them what they are of.
        return [line for line in lines if not line.startswith("#")]

    assert len(poses("program.txt")) > 10
    assert poses("program.txt") == poses("python.txt")


def test_maps_that_merge_say_by_which_similarity() -> None:
    # Out, covered for so long that nothing of before is in view any more, on, and back: the second map meets the first.
    source = cairn.open(WORLD + "&seed=2&duration=9")
    frames, truth = list(source), source.truth
    assert truth is not None
    dark = np.zeros((240, 320), np.uint8)
    first = frames[0].depth
    assert first is not None
    nothing = np.zeros_like(np.asarray(first))
    order = [*range(31), *[-1] * 25, *range(56, 86), *range(85, 0, -1)]
    slam = cairn.Slam(source.rig, rate_hz=10.0)
    seen: list[cairn.Event] = []
    outputs: list[cairn.Output] = []
    for k, i in enumerate(order):
        image, depth = (frames[i].image, frames[i].depth) if i >= 0 else (dark, nothing)
        outputs.append(slam.track(image, depth=depth, stamp=0.1 * k))
        seen.extend(slam.events())
    created = [e for e in seen if isinstance(e, cairn.MapCreated)]
    (merged,) = [e for e in seen if isinstance(e, cairn.MapsMerged)]
    assert [e.map for e in created] == slam.map.maps + [merged.from_map]
    assert merged.into_map == created[0].map and list(slam.events()) == []
    s = merged.into_from
    assert s.scale == 1.0
    np.testing.assert_array_equal(np.asarray(s), s.matrix)
    np.testing.assert_allclose(rotation(s.quaternion), s.matrix[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(s.translation, s.matrix[:3, 3])
    # What was in the younger map is carried to where it truly is in the older one, whose frame is that of the first pose.
    at = {t: pose for t, pose in zip(truth.stamps_ns.tolist(), truth.poses)}
    origin = np.linalg.inv(at[frames[0].stamp_ns])
    checked = 0
    for i, output in zip(order, outputs):
        if output.scale is not None and output.scale.map == merged.from_map:
            assert output.world_from_body is not None
            is_at = (s.matrix @ output.world_from_body)[:3, 3]
            true = (origin @ at[frames[i].stamp_ns])[:3, 3]
            assert np.linalg.norm(is_at - true) < 0.12
            checked += 1
    assert checked > 20


def test_gravity_alignment_is_an_event(stereo_walk: Walk) -> None:
    slam = cairn.Slam(stereo_walk.rig, "stereo-imu", rate_hz=10.0)
    assert stereo_walk.rig.imu is not None
    for frame in stereo_walk.frames:
        slam.track(frame)
    events = list(slam.events())
    aligned = [e for e in events if isinstance(e, cairn.GravityAligned)]
    assert isinstance(events[0], cairn.MapCreated)
    if slam.is_metric and aligned:
        assert aligned[0].map == events[0].map and aligned[0].aligned_from_former.scale > 0.5


def test_saved_maps_are_found_again_and_stay_as_they_are(long_walk: Walk, tmp_path: Path) -> None:
    slam = cairn.Slam(long_walk.rig, rate_hz=10.0)
    with pytest.raises(cairn.MapError, match="no key frames"):
        slam.save(tmp_path / "empty.map")
    for frame in long_walk.frames[:40]:
        slam.track(frame)
    slam.finish()
    file = tmp_path / "walk.map"
    assert slam.save(file) == file.stat().st_size
    loaded = cairn.load_map(file)
    np.testing.assert_array_equal(loaded.points(), slam.map.points())
    np.testing.assert_array_equal(loaded.key_frames().poses, slam.map.key_frames().poses)
    assert loaded.routes == {}

    there = cairn.Slam(long_walk.rig, map=file, localize_only=True, rate_hz=10.0)
    version = there.map.version
    outputs = [there.track(frame) for frame in long_walk.frames[10:30]]
    assert sum(o.world_from_body is not None for o in outputs) > 15
    assert there.map.version == version and there.notes == []

    on = cairn.Slam(long_walk.rig, map=str(file), rate_hz=10.0)
    for frame in long_walk.frames[30:]:
        on.track(frame)
    assert on.map.key_frame_count > loaded.key_frame_count

    broken = tmp_path / "broken.map"
    broken.write_bytes(file.read_bytes()[:1000])
    for bad in (broken, tmp_path / "none.map", tmp_path):
        with pytest.raises(cairn.MapError):
            cairn.load_map(bad)
        with pytest.raises(cairn.MapError):
            cairn.Slam(long_walk.rig, map=bad)
    other = cairn.Rig(cairn.Camera(640, 480, 500.0, 500.0, 319.5, 239.5))
    with pytest.raises(cairn.Error):
        cairn.Slam(other, map=file)


def test_configurations_are_dictionaries_or_toml(walk: Walk) -> None:
    few = {"front_end": {"orb": {"features": 300}}}
    by_toml = cairn.Config("[front_end.orb]\nfeatures = 300\n")
    assert cairn.Config(few) == by_toml != cairn.Config()
    assert cairn.Config(cairn.Config.default_toml()) == cairn.Config() == cairn.Config({})
    assert cairn.Config(by_toml.to_dict()) == by_toml == cairn.Config(by_toml.to_toml())
    for config in (few, by_toml, by_toml.to_toml()):
        output = cairn.Slam(walk.rig, None, config).track(walk.frames[0])
        assert 200 < output.evidence.features < 400
    for bad in ({"front_end": {"feetures": 1}}, {"tracker": {"min_inliers": "many"}}, "x = [", {"x": 2**70}):
        with pytest.raises(cairn.ConfigError):
            cairn.Config(bad)
    itself: dict[str, object] = {}
    itself["itself"] = itself
    with pytest.raises(cairn.ConfigError, match="nested too deeply"):
        cairn.Config(itself)


def test_sensors_are_those_of_the_rig(walk: Walk, stereo_walk: Walk) -> None:
    cairn.Slam(walk.rig, "mono")
    cairn.Slam(walk.rig, "rgbd")
    with pytest.raises(cairn.RigError):
        cairn.Slam(walk.rig, "stereo")
    with pytest.raises(cairn.RigError):
        cairn.Slam(walk.rig, "rgbd-imu")
    with pytest.raises(ValueError, match="there is no sensor"):
        cairn.Slam(walk.rig, "lidar")  # type: ignore[arg-type]
    with pytest.raises(cairn.ConfigError, match="not a positive number"):
        cairn.Slam(walk.rig, rate_hz=0.0)
    with pytest.raises(ValueError, match="localize_only needs a map"):
        cairn.Slam(walk.rig, localize_only=True)
    slam = cairn.Slam(stereo_walk.rig, "stereo")
    assert isinstance(slam.track(stereo_walk.frames[0]).state, cairn.Tracking)


def test_live_runner_tracks(walk: Walk) -> None:
    slam = cairn.Slam(walk.rig, threaded=True, rate_hz=10.0)
    outputs = [slam.track(frame) for frame in walk.frames]
    slam.finish()
    assert sum(o.world_from_body is not None for o in outputs) > 15
    assert slam.accuracy(walk.truth).ate_rmse_m < 0.05


def test_euroc_is_as_accurate_as_in_rust() -> None:
    source = cairn.open(recording("euroc-mh01"), frames=100)
    slam = cairn.Slam.for_source(source, "stereo-imu")
    for frame in source:
        slam.track(frame.image, right=frame.right, imu=frame.imu, stamp_ns=frame.stamp_ns)
    slam.finish()
    assert source.truth is not None
    error = slam.accuracy(source.truth)
    print(f"EuRoC MH_01, 100 frames: {error}")
    # The limit of the same example in Rust (crates/cairn/tests/suite/examples.rs).
    assert error.ate_rmse_m < 0.05 and slam.is_metric
