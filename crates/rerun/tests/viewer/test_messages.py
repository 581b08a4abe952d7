"""`cairn-rerun`, from messages to what the loader of the viewer finds."""

import os
import subprocess

import numpy as np
import pytest
from postcard import END, at, axes, begin, boxes, image, lens, lines, number, pixels, points, pose, show, words
from viewer import Recording

CAIRN_RERUN = os.environ["CAIRN_RERUN"]
# As EuRoC has it, in nanoseconds from 1970; and as a recording without such stamps.
EPOCH = 1403636579763555584


def write(path, messages):
    return subprocess.run([CAIRN_RERUN, path], input=messages, capture_output=True, timeout=60)


@pytest.fixture
def opened(tmp_path):
    recordings = []

    def open_messages(messages):
        path = tmp_path / f"{len(recordings)}.rrd"
        done = write(path, messages)
        assert done.returncode == 0, done.stderr
        recordings.append(Recording(path))
        return recordings[-1]

    yield open_messages
    for recording in recordings:
        recording.close()


def test_everything_that_can_be_shown_is_found(opened):
    turned = (0.5, -0.5, 0.5, 0.5)
    gray = list(range(6))
    shown = [
        show("map0", *axes(True)),
        show("map0/body", *pose((1, 2, 3), turned)),
        show("map0/odom", *pose((0, 0, 1), (0, 0, 0, 1), 2.5)),
        show("map0/cam0/image", *lens((3, 2), (100, 110), (1, 0.5))),
        show("map0/cam0/image", *image((3, 2), gray)),
        show("map0/cam0/image/features", *pixels([(0, 1), (2, 0.25)])),
        show("map0/points", *points([(1, 2, 3), (4, 5, 6)])),
        show("map0/loops", *lines([[(0, 0, 0), (1, 0, 0)], [(2, 0, 0), (3, 0, 0), (3, 1, 0)]])),
        show("map0/submaps/0", *boxes([((-1, 0, 1), (1, 4, 2))])),
        show("said", *words(True, "Stop. Turn left.")),
        show("numbers/landmarks", *number(1234.5)),
    ]
    recording = opened(begin("a walk") + at(EPOCH, 7) + b"".join(shown) + END)
    assert recording.column("/map0/body", "translation") == [(EPOCH, [[1, 2, 3]])]
    assert recording.last("/map0/body", "quaternion") == [list(turned)]
    assert "/map0/body:Transform3D:scale" not in recording.names
    assert recording.last("/map0/odom", "scale") == [[2.5, 2.5, 2.5]]
    assert recording.last("/map0/cam0/image", "buffer") == [gray]
    # Pixel centres are at integers here, and at halves in rerun.
    assert recording.last("/map0/cam0/image/features", "positions") == [[0.5, 1.5], [2.5, 0.75]]
    matrix = np.array(recording.static("/map0/cam0/image", "image_from_camera")).reshape(3, 3).T
    assert (matrix == [[100, 0, 1.5], [0, 110, 1], [0, 0, 1]]).all()
    assert recording.static("/map0/cam0/image", "resolution") == [[3, 2]]
    assert recording.last("/map0/points", "positions") == [[1, 2, 3], [4, 5, 6]]
    assert recording.last("/map0/points", "colors") == [0xF03C3CFF]
    assert recording.last("/map0/loops", "strips") == [[[0, 0, 0], [1, 0, 0]], [[2, 0, 0], [3, 0, 0], [3, 1, 0]]]
    assert recording.last("/map0/submaps/0", "centers") == [[0, 2, 1.5]]
    assert recording.last("/map0/submaps/0", "half_sizes") == [[1, 2, 0.5]]
    assert recording.last("/said", "text") == ["Stop. Turn left."]
    assert recording.last("/said", "level") == ["WARN"]
    assert recording.last("/numbers/landmarks", "scalars") == [1234.5]
    assert recording.column("/said", "text", index="frame") == [(7, ["Stop. Turn left."])]


def test_later_messages_replace_earlier_ones_in_time(opened):
    steps = [at(i * 50_000_000, i) + show("map0/points", *points([(i, 0, 0)] * i)) for i in range(4)]
    recording = opened(begin("counted") + b"".join(steps) + END)
    column = recording.column("/map0/points", "positions")
    assert [t for t, _ in column] == [0, 50_000_000, 100_000_000, 150_000_000]
    # An entity that shows nothing any more is emptied, not left as it was.
    assert [len(v) for _, v in column] == [0, 1, 2, 3]


def test_messages_that_end_early_leave_a_readable_recording(tmp_path):
    path = tmp_path / "cut.rrd"
    messages = begin("x") + at(5, 0) + show("said", *words(False, "hello"))
    for cut, why in [(messages, b"end before the run does"), (messages + END[:-1], b"failed to fill")]:
        done = write(path, cut)
        assert done.returncode == 1 and why in done.stderr, done.stderr
        recording = Recording(path)
        assert recording.column("/said", "text") == [(5, ["hello"])]
        recording.close()


def test_what_are_no_messages_is_refused(tmp_path):
    path = tmp_path / "x.rrd"
    short = show("i", *image((3, 2), [0] * 5))
    for messages, why in [
        (b"", b"failed to fill"),
        (b"\x07\0\0\0", b"version 7"),
        (begin("x")[:9], b"not the beginning"),
        (begin("x") + begin("y")[4:] + END, b"begins twice"),
        (begin("x") + short + END, b"an image of 3x2 has 5 pixels"),
        (begin("x") + b"\xff\xff\xff\xff", b"longer than"),
        (begin("x") + b"\x01\0\0\0\x63", b"no message"),
    ]:
        done = write(path, messages)
        assert done.returncode == 1 and why in done.stderr, (messages, done.stderr)
    done = write(tmp_path / "no" / "folder.rrd", begin("x") + END)
    assert done.returncode == 1 and b"No such file" in done.stderr, done.stderr
    assert subprocess.run([CAIRN_RERUN], capture_output=True, timeout=60).returncode == 2
