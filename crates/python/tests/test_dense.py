"""Dense surfaces: voxels and meshes as arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Walk

import cairn

CAMERA = cairn.Camera(64, 48, 60.0, 60.0, 31.5, 23.5)


def wall(metres: float) -> np.ndarray[Any, np.dtype[np.float32]]:
    return np.full((48, 64), metres, np.float32)


def test_a_wall_is_a_plane_of_triangles(tmp_path: Path) -> None:
    volume = cairn.DenseVolume(CAMERA, voxel_m=0.02)
    assert len(volume.voxels()) == 0 and volume.mesh().vertices.shape == (0, 3)
    volume.integrate(wall(1.5), np.eye(4))
    volume.integrate((wall(1.5) * 1000).astype(np.uint16), np.eye(4))
    mesh, voxels = volume.mesh(), volume.voxels()
    assert len(mesh.vertices) > 500 and mesh.triangles.dtype == np.uint32 and mesh.colors is None
    np.testing.assert_allclose(mesh.vertices[:, 2], 1.5, atol=1e-3)
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0, -1], (len(mesh.normals), 1)), atol=1e-3)
    assert mesh.triangles.max() == len(mesh.vertices) - 1
    # A voxel's distance is that of its centre to the wall, positive before it, up to four voxels.
    before = np.clip(1.5 - voxels.centers[:, 2], -0.08, 0.08)
    np.testing.assert_allclose(before, voxels.distances, atol=5e-3)
    np.testing.assert_allclose(voxels.centers, (voxels.indices + 0.5) * voxels.voxel_m)
    assert voxels.weights.min() > 0 and len(voxels) == len(voxels.weights)
    depth, normals = volume.raycast(CAMERA, np.eye(4))
    assert depth.shape == (48, 64) and normals.shape == (48, 64, 3)
    np.testing.assert_allclose(depth[24, 32], 1.5, atol=1e-3)
    for ending in ("ply", "obj", "glb"):
        mesh.save(tmp_path / f"wall.{ending}")
        assert (tmp_path / f"wall.{ending}").stat().st_size > 10_000
    with pytest.raises(ValueError, match="end in"):
        mesh.save(tmp_path / "wall.stl")


def test_colors_are_those_of_the_image() -> None:
    volume = cairn.DenseVolume(CAMERA, color=True)
    orange = np.tile(np.array([250, 120, 10], np.uint8), (48, 64, 1))
    for _ in range(3):
        volume.integrate(wall(1.0), np.eye(4), image=orange[:, :, ::-1], color="bgr")
    colors = volume.mesh().colors
    assert colors is not None
    np.testing.assert_allclose(colors, np.tile([250, 120, 10], (len(colors), 1)), atol=2)


def test_surface_of_a_walk_is_where_the_depth_was(walk: Walk) -> None:
    slam, camera = cairn.Slam(walk.rig, rate_hz=10.0), walk.rig.depth_camera
    assert camera is not None and walk.rig.depth_scale is not None
    volume = cairn.DenseVolume(camera, depth_scale=walk.rig.depth_scale, voxel_m=0.03)
    at, image = np.eye(4), np.zeros((0, 0), np.uint16)
    for frame in walk.frames:
        pose = slam.track(frame).world_from_body
        assert pose is not None and frame.depth is not None
        at, image = pose @ camera.body_from_camera, frame.depth
        volume.integrate(image, at)
    depth, _ = volume.raycast(camera, at)
    measured = image * walk.rig.depth_scale
    both = (depth > 0) & (measured > 0.5) & (measured < 4.5)
    assert both.mean() > 0.5 and np.median(np.abs(depth - measured)[both]) < 0.02


def test_what_cannot_be_fused_says_why() -> None:
    volume = cairn.DenseVolume(CAMERA)
    far = np.eye(4)
    far[0, 3] = 1e9
    cases: list[tuple[str, Callable[[], object]]] = [
        ("covered", lambda: volume.integrate(wall(0.0), np.eye(4))),
        ("too far", lambda: volume.integrate(wall(50.0), np.eye(4))),
        ("range|pose", lambda: volume.integrate(wall(1.0), far)),
        ("64x48", lambda: volume.integrate(np.ones((48, 63), np.float32), np.eye(4))),
        ("4x4", lambda: volume.integrate(wall(1.0), np.eye(3))),
        ("no colours", lambda: volume.integrate(wall(1.0), np.eye(4), image=np.zeros((48, 64), np.uint8))),
        ("voxels", lambda: cairn.DenseVolume(CAMERA, voxel_m=1.0)),
        ("per unit", lambda: cairn.DenseVolume(CAMERA, depth_scale=-1.0)),
        ("depths from", lambda: cairn.DenseVolume(CAMERA, farthest_m=float("nan"))),
        ("farthest_m", lambda: volume.raycast(CAMERA, np.eye(4), farthest_m=float("inf"))),
    ]
    for words, call in cases:
        with pytest.raises(ValueError, match=words):
            call()
    with pytest.raises(TypeError, match="bool"):
        volume.integrate(np.ones((48, 64), bool), np.eye(4))
    assert len(volume.mesh().vertices) == 0
