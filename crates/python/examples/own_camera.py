"""A depth camera of your own: the calibration is written down here, images are fed by hand.

A simulated world stands in for the camera: `grab` is the part to replace by your driver.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

import cairn

Image = npt.NDArray[np.uint8]
Depth = npt.NDArray[np.float32]


def grab() -> Iterator[tuple[float, Image, Depth]]:
    """Time of exposure in seconds, a colour image, and depth in metres of the same pixels."""
    for frame in cairn.open("sim:demo?seed=2&sensor=rgbd&resolution=320x240&focal=210&rate=10&duration=4&detail=0.5"):
        assert frame.depth is not None
        color = np.repeat(frame.image[:, :, np.newaxis], 3, axis=2)
        yield frame.stamp, color, frame.depth.astype(np.float32) * 0.001


camera = cairn.Camera(320, 240, 210.0, 210.0, 159.5, 119.5)
rig = cairn.Rig(camera, depth_scale=0.001)
slam = cairn.Slam(rig, "rgbd", rate_hz=10.0)
surface = cairn.DenseVolume(camera, voxel_m=0.03)

for number, (stamp, image, depth) in enumerate(grab()):
    output = slam.track(image, depth=depth, stamp=stamp)
    if output.world_from_body is not None:
        surface.integrate(depth, output.world_from_body @ camera.body_from_camera)
        if number % 10 == 0:
            x, y, z = output.world_from_body[:3, 3]
            print(f"{stamp:.1f} s  at {x:6.2f} {y:6.2f} {z:6.2f} m, {output.evidence.inliers} matches agree")

slam.finish()
mesh = surface.mesh()
mesh.save("surface.ply")
print(f"map       {slam.map.points().shape[0]} landmarks")
print(f"surface   {mesh.vertices.shape[0]} vertices, {mesh.triangles.shape[0]} triangles in surface.ply")
