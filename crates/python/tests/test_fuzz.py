"""Whatever is given, the answer is an exception of Python: no abort, no panic."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from conftest import Walk
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import cairn

# A panic of Rust would be pyo3_runtime.PanicException, which is no Exception.
REFUSED = (TypeError, ValueError, KeyError, OSError, OverflowError, cairn.Error)

settings.register_profile(
    "cairn",
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
settings.load_profile("cairn")

numbers = st.one_of(
    st.floats(),
    st.integers(),
    st.sampled_from([0, -1, 1, 2**31, 2**63, 2**64, -(2**70), 1e308, float("nan"), float("inf")]),
)
scalars = st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=8), st.binary(max_size=8))
dtypes = cast(Any, st.one_of(npst.scalar_dtypes(), npst.array_dtypes(max_size=2), st.just(np.dtype(object))))
arrays = npst.arrays(
    dtype=dtypes,
    shape=npst.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=8),
)
images = st.one_of(
    npst.arrays(st.sampled_from([np.dtype(t) for t in ("u1", "u2", "f4", "f8", ">u2", ">f4")]), st.just((12, 16))),
    npst.arrays(np.uint8, st.just((12, 16, 3))),
)
anything = st.one_of(scalars, arrays, images, st.lists(scalars, max_size=3))
tables = npst.arrays(np.float64, st.tuples(st.integers(0, 5), st.just(7)), elements=st.floats(width=64))


def small_rig() -> cairn.Rig:
    camera = cairn.Camera(16, 12, 15.0, 15.0, 7.5, 5.5)
    right = np.eye(4)
    right[0, 3] = 0.1
    second = cairn.Camera(16, 12, 15.0, 15.0, 7.5, 5.5, body_from_camera=right)
    return cairn.Rig([camera, second], depth_scale=0.001, imu=cairn.Imu())


def tried(call: Any) -> Any:
    """The result, or None where it was refused."""
    try:
        return call()
    except REFUSED as error:
        assert str(error), type(error)
        return None


@pytest.mark.filterwarnings("ignore::cairn.DataWarning")
@given(
    image=st.one_of(images, anything),
    depth=st.one_of(st.none(), images, anything),
    right=st.one_of(st.none(), images, anything),
    imu=st.one_of(st.none(), tables, anything),
    stamp=st.one_of(numbers, scalars),
    scale=st.one_of(st.none(), numbers),
    color=st.one_of(st.just("rgb"), scalars),
)
def test_track(image: Any, depth: Any, right: Any, imu: Any, stamp: Any, scale: Any, color: Any) -> None:
    slam: Any = cairn.Slam(small_rig(), "rgbd-imu")
    output = tried(
        lambda: slam.track(image, depth, right, imu, stamp=stamp, depth_scale=scale, color=color)
    )
    assert output is None or repr(output)
    # It goes on afterwards.
    flat = np.full((12, 16), 1000, np.uint16)
    slam.track(np.zeros((12, 16), np.uint8), flat, stamp_ns=2**63 - 1)


@given(imu=tables)
def test_any_table_of_seven_columns_is_taken_or_refused(imu: Any) -> None:
    batch = tried(
        lambda: cairn.ImuBatch(accel=imu[:, :3], gyro=imu[:, 3:6], stamps=imu[:, 6])
    )
    if batch is not None:
        assert np.isfinite(batch.array).all() and (np.diff(batch.stamps_ns) > 0).all()


@given(
    size=st.tuples(st.one_of(st.integers(1, 64), numbers), st.one_of(st.integers(1, 64), numbers)),
    lens=st.tuples(*[st.one_of(st.floats(1, 100), numbers)] * 4),
    distortion=st.one_of(
        st.sampled_from(["none", "radial-tangential", "rational", "equidistant", "fov", "double-sphere"]), scalars
    ),
    coefficients=st.one_of(st.lists(st.floats(-1, 1), max_size=8), st.lists(st.floats(), max_size=8), scalars),
    pose=st.one_of(st.none(), npst.arrays(np.float64, (4, 4)), anything),
)
def test_cameras(size: Any, lens: Any, distortion: Any, coefficients: Any, pose: Any) -> None:
    def make() -> cairn.Camera:
        return cairn.Camera(
            *size, *lens, distortion=distortion, coefficients=coefficients, body_from_camera=pose
        )

    camera = tried(make)
    if camera is not None:
        slam = tried(lambda: cairn.Slam(cairn.Rig(camera)))
        small = camera.width * camera.height < 10_000
        if slam is not None and small:
            tried(lambda: slam.track(np.zeros((camera.height, camera.width), np.uint8), stamp=0.0))
        if small:
            volume = tried(lambda: cairn.DenseVolume(camera))
            depth = np.ones((camera.height, camera.width), np.float32)
            if volume is not None:
                tried(lambda: volume.integrate(depth, np.eye(4)))


@given(arguments=st.fixed_dictionaries({}, optional={
    "gyro_noise": numbers, "gyro_walk": numbers, "accel_noise": numbers, "accel_walk": numbers,
    "rate_hz": numbers, "offset_s": numbers, "body_from_imu": anything,
}))
def test_imus(arguments: Any) -> None:
    camera = cairn.Camera(16, 12, 15.0, 15.0, 7.5, 5.5)
    rig = tried(lambda: cairn.Rig(camera, imu=cairn.Imu(**arguments)))
    assert rig is None or repr(rig)
    tried(lambda: cairn.Rig(camera, depth_scale=arguments.get("rate_hz")))


@given(
    entries=st.recursive(
        st.one_of(scalars, st.floats(), st.integers()),
        lambda inner: st.one_of(
            st.dictionaries(st.sampled_from(["front_end", "orb", "features", "tracker", "new_map_s", "x"]), inner),
            st.lists(inner, max_size=3),
        ),
        max_leaves=8,
    )
)
def test_configurations(entries: Any) -> None:
    config = tried(lambda: cairn.Config(entries))
    if config is not None:
        assert cairn.Config(config.to_toml()) == config


@given(text=st.one_of(st.text(max_size=20), st.from_regex(r"sim:(demo|hall|office)\?([a-z_]+=[-0-9.a-zx]{1,6}&?){0,3}", fullmatch=True)))
def test_addresses(text: str) -> None:
    # A camera or a stream would be waited for, and a large world rendered.
    if any(word in text for word in ("camera", "://", "resolution", "detail", "size", "rate", "passers", "look")):
        return
    if Path(text).exists():
        return
    source = tried(lambda: cairn.open(text, frames=1))
    assert source is None or repr(source)


@given(path=st.one_of(scalars, st.text(max_size=10)), content=st.binary(max_size=200))
def test_files(path: Any, content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "file"
        file.write_bytes(content)
        loads: list[Any] = [cairn.load_map, cairn.Rig.load, cairn.Config.load, cairn.Trajectory.load, cairn.Route.load]
        for load in loads:
            tried(lambda: load(file))
            if not (isinstance(path, (str, bytes)) and path and Path(str(path)).exists()):
                tried(lambda: load(path))
        slam = cairn.Slam(small_rig(), "mono")
        tried(lambda: slam.load_route(file))
        for where in (folder, "\0", ""):
            tried(lambda: slam.save(where))


@given(
    depth=st.one_of(images, anything),
    pose=st.one_of(st.just(np.eye(4)), npst.arrays(np.float64, (4, 4)), anything),
    settings_=st.fixed_dictionaries({}, optional={"depth_scale": numbers, "voxel_m": numbers, "farthest_m": numbers}),
    image=st.one_of(st.none(), images, anything),
)
def test_dense_volumes(depth: Any, pose: Any, settings_: Any, image: Any) -> None:
    camera = cairn.Camera(16, 12, 15.0, 15.0, 7.5, 5.5)
    volume = tried(lambda: cairn.DenseVolume(camera, color=image is not None, **settings_))
    if volume is not None:
        tried(lambda: volume.integrate(depth, pose, image=image))
        tried(lambda: volume.raycast(camera, pose))
        assert len(volume.voxels()) >= 0 and repr(volume.mesh())


@given(poses=st.one_of(st.lists(npst.arrays(np.float64, (4, 4)), max_size=2), anything), stamps=anything)
def test_trajectories(poses: Any, stamps: Any) -> None:
    for name in ("stamps", "stamps_ns"):
        path = tried(lambda: cairn.Trajectory(poses, **{name: stamps}))
        assert path is None or len(path.poses) == len(path)


@given(names=st.lists(st.one_of(st.integers(), scalars), min_size=1, max_size=3))
def test_names_of_maps(walk: Walk, names: Any) -> None:
    slam = cairn.Slam(walk.rig)
    slam.track(walk.frames[0])
    for name in names:
        for method in (slam.map.points, slam.map.key_frames, slam.map.landmarks, slam.map.trajectory):
            tried(lambda: method(name))


def test_objects_without_a_constructor_say_so() -> None:
    for kind in (cairn.Source, cairn.Output, cairn.Map, cairn.Lost, cairn.Frame):
        with pytest.raises(TypeError, match="cannot create"):
            kind()
