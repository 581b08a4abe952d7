"""Recordings of `cairn run --rerun`, read by the loader of the viewer and compared with the other results of the same run."""

import json
import os
import shutil
import subprocess

import numpy as np
import pytest
from viewer import Recording

CAIRN = os.environ["CAIRN"]
# A walk of 30 s through an office, with depth, that comes back to a room it has seen, so that a loop is closed.
WORLD = "sim:office?sensor=rgbd&resolution=320x240&seed=3&duration=30"
SCRIPT = "tracked 5 record\nat 12 stop\n"


def tum(path):
    """Stamps in nanoseconds, positions, quaternions with the real part last."""
    rows = np.loadtxt(path, ndmin=2)
    return np.round(rows[:, 0] * 1e9).astype(np.int64), rows[:, 1:4], rows[:, 4:8]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    (folder / "script").write_text(SCRIPT)
    arguments = [CAIRN, "run", WORLD, "--rerun", "run.rrd", "--trajectory", "end.tum", "--live-trajectory", "live.tum"]
    arguments += ["--report", "report.json", "--dense", "--script", "script", "--events", "events.jsonl", "--say", "text"]
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    recording = Recording(folder / "run.rrd")
    yield folder, recording, done.stdout
    recording.close()


def test_poses_are_those_of_the_live_trajectory(run):
    folder, recording, _ = run
    stamps, positions, quaternions = tum(folder / "live.tum")
    shown = recording.column("/map0/body", "translation")
    turned = recording.column("/map0/body", "quaternion")
    assert len(shown) == len(stamps) > 100
    assert [t for t, _ in shown] == stamps.tolist()
    assert np.allclose([v[0] for _, v in shown], positions, atol=1e-5)
    signs = [abs(np.dot(v[0], q)) for (_, v), q in zip(turned, quaternions)]
    assert np.allclose(signs, 1.0, atol=1e-6)


def test_the_line_at_the_end_is_the_corrected_trajectory(run):
    folder, recording, _ = run
    _, positions, _ = tum(folder / "end.tum")
    strips = recording.column("/map0/trajectory", "strips")[-1][1]
    assert np.allclose(np.concatenate([np.array(s) for s in strips]), positions, atol=1e-5)


def test_odometry_has_no_steps_and_its_transform_gives_the_map(run):
    _, recording, _ = run
    odom = np.array([v[0] for _, v in recording.column("/odom0/body", "translation")])
    body = np.array([v[0] for _, v in recording.column("/map0/body", "translation")])
    assert np.linalg.norm(np.diff(odom, axis=0), axis=1).max() < 0.2
    at = np.array([v[0] for _, v in recording.column("/map0/odom", "translation")])
    turn = np.array([v[0] for _, v in recording.column("/map0/odom", "quaternion")])
    xyz, w = turn[:, :3], turn[:, 3:]
    cross = 2 * np.cross(xyz, odom)
    assert np.allclose(odom + w * cross + np.cross(xyz, cross) + at, body, atol=1e-4)


def test_key_frames_points_and_loops_are_those_of_the_report(run):
    folder, recording, _ = run
    report = json.loads((folder / "report.json").read_text())
    key_frames = np.array(recording.last("/map0/key_frames", "positions"))
    assert len(key_frames) == report["keyframes"]
    assert len(recording.last("/map0/points", "positions")) == report["landmarks"]
    assert len(recording.last("/map0/spanning_tree", "strips")) == report["keyframes"] - 1
    assert report["loops"] >= 1
    loops = np.array(recording.last("/map0/loops", "strips"))
    assert len(loops) >= report["loops"]
    # Both ends of an edge are key frames.
    for end in loops.reshape(-1, 3):
        assert np.linalg.norm(key_frames - end, axis=1).min() < 1e-5


def test_images_have_their_features_and_lens(run):
    _, recording, _ = run
    images = recording.column("/map0/cam0/image", "buffer")
    assert len(images) > 20
    assert all(len(v[0]) == 320 * 240 and np.ptp(v[0]) > 50 for _, v in images)
    pixels = recording.column("/map0/cam0/image/features", "positions")
    assert len(pixels) == len(images)
    points = np.concatenate([np.array(v) for _, v in pixels])
    assert points.min() >= 0 and points[:, 0].max() <= 320 and points[:, 1].max() <= 240 and len(points) > 1000
    assert recording.static("/map0/cam0/image", "resolution") == [[320.0, 240.0]]


def test_route_words_submaps_and_events_are_there(run):
    _, recording, stdout = run
    assert len(recording.last("/map0/route", "strips")[0]) > 10
    said = [v[0] for _, v in recording.column("/said", "text")]
    assert said and all(words in stdout for words in said)
    submaps = {e for e in recording.entities if e.startswith("/map0/submaps/")}
    assert submaps
    assert all((np.array(recording.last(e, "half_sizes")) > 0.1).all() for e in submaps)
    assert any("loop" in v[0].lower() for _, v in recording.column("/events", "text"))


def test_a_run_without_the_program_is_refused_and_a_failure_of_it_is_told(tmp_path):
    copy = tmp_path / "bin" / "cairn"
    copy.parent.mkdir()
    shutil.copy(CAIRN, copy)
    short = ["run", "sim:demo?duration=1&resolution=320x240&sensor=rgbd", "--rerun", str(tmp_path / "x.rrd")]
    done = subprocess.run([copy, *short], capture_output=True, text=True, env={"PATH": "/nowhere"}, timeout=60)
    assert done.returncode == 1 and "cairn-rerun is not installed" in done.stderr, done.stderr
    broken = copy.with_name("cairn-rerun")
    broken.write_text("#!/bin/sh\necho 'it is broken' >&2\nexit 1\n")
    broken.chmod(0o755)
    done = subprocess.run([copy, *short], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "it is broken" in done.stderr, done.stderr
