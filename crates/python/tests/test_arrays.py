"""Arrays of any sensible stride and dtype give the same bits; others give an exception."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conftest import Walk, as_they_are, digest

import cairn

Gray = npt.NDArray[np.uint8]
Depth = npt.NDArray[Any]


def strided(a: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same elements with gaps between pixels and rows, backwards in memory."""
    wide: npt.NDArray[Any] = np.zeros((2 * a.shape[0] + 1, 3 * a.shape[1] + 2), a.dtype)
    view: npt.NDArray[Any] = wide[::2][: a.shape[0], ::3][:, : a.shape[1]][::-1, ::-1]
    view[...] = a
    assert not view.flags.contiguous and view.strides[0] < 0
    return view


def unaligned(a: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The same elements at an odd address."""
    memory = np.zeros(a.nbytes + 1, np.uint8)
    view: npt.NDArray[Any] = memory[1:].view(a.dtype).reshape(a.shape)
    view[...] = a
    assert a.dtype.itemsize == 1 or not view.flags.aligned
    return view


def read_only(a: npt.NDArray[Any]) -> npt.NDArray[Any]:
    view: npt.NDArray[Any] = a.copy()
    view.flags.writeable = False
    return view


GRAYS: dict[str, Callable[[Any], Any]] = {
    "as it is": lambda a: a,
    "read-only": read_only,
    "column-major": np.asfortranarray,
    "strided, backwards": strided,
    "one channel": lambda a: a[:, :, None],
    "three equal channels": lambda a: np.repeat(a[:, :, None], 3, axis=2),
    "four channels, strided": lambda a: np.repeat(a[:, :, None], 8, axis=2)[:, :, ::2],
    "a list of rows": lambda a: [row for row in a],
}

DEPTHS: dict[str, Callable[[Any], Any]] = {
    "as it is": lambda a: a,
    "read-only": read_only,
    "column-major": np.asfortranarray,
    "strided, backwards": strided,
    "unaligned": unaligned,
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder()),
    "one channel": lambda a: a[:, :, None],
    "float64, metres": lambda a: a * 0.001,
    "float32, metres": lambda a: (a * 0.001).astype(np.float32),
    "float32, strided": lambda a: strided((a * 0.001).astype(np.float32)),
    "float32, NaN where nothing was measured": lambda a: np.where(a == 0, np.nan, a * 0.001).astype(np.float32),
}


@pytest.fixture(scope="module")
def expected(walk: Walk) -> int:
    assert walk.rig.depth_scale == 0.001
    return digest(walk, as_they_are)


@pytest.mark.parametrize("kind", GRAYS)
def test_images_of_any_stride_give_the_same_bits(walk: Walk, expected: int, kind: str) -> None:
    of = GRAYS[kind]
    assert expected == digest(
        walk, lambda slam, _, f: slam.track(of(f.image), depth=f.depth, stamp_ns=f.stamp_ns)
    )


@pytest.mark.parametrize("kind", DEPTHS)
def test_depths_of_any_stride_and_type_give_the_same_bits(walk: Walk, expected: int, kind: str) -> None:
    of = DEPTHS[kind]

    def feed(slam: cairn.Slam, _: int, f: cairn.Frame) -> cairn.Output:
        assert f.depth is not None
        return slam.track(f.image, depth=of(f.depth), stamp_ns=f.stamp_ns)

    assert expected == digest(walk, feed)


def test_depth_scale_overrides_the_unit(walk: Walk, expected: int) -> None:
    def feed(slam: cairn.Slam, number: int, f: cairn.Frame) -> cairn.Output:
        assert f.depth is not None
        depth: Depth = f.depth.astype(np.float32) * 0.5 if number % 2 else f.depth
        scale = 0.002 if number % 2 else 0.001
        return slam.track(f.image, depth=depth, depth_scale=scale, stamp_ns=f.stamp_ns)

    assert expected == digest(walk, feed)


def test_frames_that_the_caller_overwrites_at_once_give_the_same_bits(walk: Walk, expected: int) -> None:
    image, depth = np.zeros((240, 320), np.uint8), np.zeros((240, 320), np.uint16)

    def feed(slam: cairn.Slam, _: int, f: cairn.Frame) -> cairn.Output:
        assert f.depth is not None
        image[...], depth[...] = f.image, f.depth
        output = slam.track(image, depth=depth, stamp_ns=f.stamp_ns)
        image[...], depth[...] = 255, 1
        return output

    assert expected == digest(walk, feed)


def test_images_are_not_kept(walk: Walk) -> None:
    frame, slam = walk.frames[0], cairn.Slam(walk.rig)
    import sys

    image = frame.image
    before = sys.getrefcount(image)
    output = slam.track(image, depth=frame.depth, stamp=1.0)
    assert sys.getrefcount(image) == before
    assert output.stamp == 1.0


def test_color_channels_are_weighted_in_their_order(walk: Walk) -> None:
    rng = np.random.default_rng(1)
    color = rng.integers(0, 256, (240, 320, 3), np.uint8)
    weights = np.array([19595, 38470, 7471], np.uint32)
    gray = ((color.astype(np.uint32) @ weights + 32768) >> 16).astype(np.uint8)
    depth = walk.frames[0].depth

    def features(image: Gray, **order: Any) -> npt.NDArray[np.float32]:
        return cairn.Slam(walk.rig).track(image, depth=depth, stamp=0.0, **order).keypoints

    expected = features(gray)
    assert len(expected) > 100
    np.testing.assert_array_equal(features(color), expected)
    np.testing.assert_array_equal(features(np.ascontiguousarray(color[:, :, ::-1]), color="bgr"), expected)
    assert not np.array_equal(features(color, color="bgr"), expected)


def test_right_image_and_imu_as_arrays_give_the_same_bits(stereo_walk: Walk) -> None:
    expected = digest(stereo_walk, as_they_are)

    def batches(slam: cairn.Slam, _: int, f: cairn.Frame) -> cairn.Output:
        return slam.track(f.image, right=f.right, imu=f.imu, stamp_ns=f.stamp_ns)

    def tables(slam: cairn.Slam, _: int, f: cairn.Frame) -> cairn.Output:
        # The times of this world are short enough to be exact to the nanosecond in float64.
        return slam.track(f.image, right=f.right, imu=f.imu.array, stamp=f.stamp)

    def keywords(slam: cairn.Slam, _: int, f: cairn.Frame) -> cairn.Output:
        b = f.imu
        imu = cairn.ImuBatch(accel=b.accel, gyro=b.gyro, stamps_ns=b.stamps_ns)
        return slam.track(f.image, right=f.right, imu=imu, stamp_ns=f.stamp_ns)

    assert len(stereo_walk.frames[3].imu) > 5
    assert expected == digest(stereo_walk, batches) == digest(stereo_walk, tables) == digest(stereo_walk, keywords)


BAD_IMAGES: list[tuple[Any, type[Exception], str]] = [
    (np.zeros((240, 321), np.uint8), cairn.FrameError, "321x240"),
    (np.zeros((320, 240), np.uint8), cairn.FrameError, "240x320"),
    (np.zeros(240 * 320, np.uint8), cairn.FrameError, "dimensions"),
    (np.zeros((240, 320, 2), np.uint8), cairn.FrameError, "colour"),
    (np.zeros((240, 320, 3, 1), np.uint8), cairn.FrameError, "colour"),
    (np.zeros((1,) * 60, np.uint8), cairn.FrameError, "1x1"),
    (np.zeros((240, 320), np.float32), TypeError, "float32"),
    (np.zeros((240, 320), np.uint16), TypeError, "uint16"),
    (np.zeros((240, 320), bool), TypeError, "bool"),
    (np.zeros((240, 320), object), TypeError, "object"),
    (np.broadcast_to(np.uint8(0), (2**30, 2**30)), cairn.FrameError, "1073741824"),
    ("image.png", TypeError, "str"),
    (None, TypeError, "NoneType"),
    ({}, TypeError, "dict"),
    (5, TypeError, "int"),
]


@pytest.mark.parametrize(("image", "error", "words"), BAD_IMAGES)
def test_bad_images_are_refused_and_the_next_frame_is_taken(
    walk: Walk, image: Any, error: type[Exception], words: str
) -> None:
    slam, frame = cairn.Slam(walk.rig), walk.frames[0]
    with pytest.raises(error, match=words):
        slam.track(image, depth=frame.depth, stamp=0.0)
    assert slam.track(frame.image, depth=frame.depth, stamp=0.0).world_from_body is not None


BAD_DEPTHS: list[tuple[Any, type[Exception], str]] = [
    (np.zeros((240, 321), np.uint16), cairn.FrameError, "depth.*321x240"),
    (np.zeros((240, 320, 3), np.uint16), cairn.FrameError, "one channel"),
    (np.zeros((240, 320), np.int32), TypeError, "int32"),
    (np.zeros((240, 320), bool), TypeError, "bool"),
    (np.zeros((240, 320), complex), TypeError, "complex"),
    (np.zeros((240, 320), "datetime64[s]"), TypeError, "datetime64"),
    (np.zeros((240, 320), [("x", np.uint16)]), TypeError, "x"),
    (np.zeros((240, 320), "U3"), TypeError, "U3"),
    (b"depth", TypeError, "bytes"),
]


@pytest.mark.parametrize(("depth", "error", "words"), BAD_DEPTHS)
def test_bad_depths_are_refused(walk: Walk, depth: Any, error: type[Exception], words: str) -> None:
    slam, frame = cairn.Slam(walk.rig), walk.frames[0]
    with pytest.raises(error, match=words):
        slam.track(frame.image, depth=depth, stamp=0.0)
    with pytest.raises(cairn.FrameError, match="no depth sensor"):
        cairn.Slam(cairn.Rig(walk.rig.cameras)).track(frame.image, depth=frame.depth, stamp=0.0)


def test_wrong_arguments_say_what_is_wrong(walk: Walk) -> None:
    slam, f = cairn.Slam(walk.rig), walk.frames[0]
    nothing: Any = None
    both: Any = 5
    cases: list[tuple[str, type[Exception], Callable[[], object]]] = [
        ("stamp", TypeError, lambda: slam.track(f.image, depth=f.depth, stamp=nothing)),
        ("not both", TypeError, lambda: slam.track(f.image, depth=f.depth, stamp=0.0, stamp_ns=nothing or both)),
        ("not a time", ValueError, lambda: slam.track(f.image, depth=f.depth, stamp=float("nan"))),
        ("not a time", ValueError, lambda: slam.track(f.image, depth=f.depth, stamp=1e300)),
        ("one camera", cairn.FrameError, lambda: slam.track(f.image, right=f.image, depth=f.depth, stamp=0.0)),
        ("depth_scale", ValueError, lambda: slam.track(f.image, depth=f.depth, depth_scale=-1.0, stamp=0.0)),
        ("color", ValueError, lambda: slam.track(f.image, depth=f.depth, color="hsv", stamp=0.0)),  # type: ignore[call-overload]
        ("alone", TypeError, lambda: slam.track(f, stamp=0.0)),  # type: ignore[call-overload]
    ]
    for words, error, call in cases:
        with pytest.raises(error, match=words):
            call()
    slam.track(f)
    with pytest.raises(cairn.FrameError, match="not later"):
        slam.track(f)


IMU_ERRORS: list[tuple[Any, type[Exception], str]] = [
    (np.zeros((3, 6)), ValueError, r"\(N, 7\)"),
    (np.zeros(7), ValueError, r"\(N, 7\)"),
    (np.zeros((2, 7)), ValueError, "not later"),
    (np.full((1, 7), np.nan), ValueError, "not a time"),
    (np.array([[np.inf, 0, 0, 0, 0, 0, 0.1]]), ValueError, "not finite"),
    (np.zeros((1, 7), complex), TypeError, "complex"),
    (np.broadcast_to(np.float64(0), (10**12, 7)), ValueError, "at most"),
    ("imu", TypeError, "str"),
    (3, TypeError, "int"),
]


@pytest.mark.parametrize(("imu", "error", "words"), IMU_ERRORS)
def test_bad_imu_batches_are_refused(stereo_walk: Walk, imu: Any, error: type[Exception], words: str) -> None:
    slam, f = cairn.Slam(stereo_walk.rig), stereo_walk.frames[0]
    with pytest.raises(error, match=words):
        slam.track(f.image, right=f.right, imu=imu, stamp=0.0)


def test_imu_batches_by_keywords_are_checked() -> None:
    two, three = np.zeros((2, 3)), np.zeros((3, 3))
    with pytest.raises(ValueError, match="accel has 2 rows, gyro 3"):
        cairn.ImuBatch(accel=two, gyro=three, stamps=[0.0, 0.1])
    with pytest.raises(ValueError, match="not later"):
        cairn.ImuBatch(accel=two, gyro=two, stamps=[0.1, 0.1])
    with pytest.raises(TypeError, match="not both"):
        cairn.ImuBatch(accel=two, gyro=two)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="int64"):
        cairn.ImuBatch(accel=two, gyro=two, stamps_ns=[0.5, 1.5])
    empty = cairn.ImuBatch(accel=np.zeros((0, 3)), gyro=np.zeros((0, 3)), stamps=[])
    assert len(empty) == 0 and empty.array.shape == (0, 7)
