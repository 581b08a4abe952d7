#!/usr/bin/env python3
"""Open3D on the frames of `cargo run --release -p bench -- dense`: TSDF, held-out depth, mesh, ray cast, registration.

Needs `pip install open3d==0.20.0` (a virtual environment outside the checkout) and, on Debian, libusb-1.0-0 and libgl1.
Times are processor time of one thread, the least of three passes. Usage: compare_dense.py [DATA_FOLDER] [fields|registration]
"""
import os
import sys
import time

os.environ["OMP_NUM_THREADS"] = "1"
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import numpy as np
import open3d as o3d
import open3d.core as o3c

FOLDERS = [a for a in sys.argv[1:] if a not in ("fields", "registration")]
DATA = FOLDERS[0] if FOLDERS else os.environ.get("CAIRN_DATA", "../shared/data")
KITCHEN = os.path.join(DATA, "7scenes-kitchen")
K = o3c.Tensor([[585.0, 0, 320], [0, 585, 240], [0, 0, 1]], o3c.float64)


def frame(number):
    stem = os.path.join(KITCHEN, f"frame-{number:06d}")
    depth = np.asarray(o3d.t.io.read_image(stem + ".depth.png").to_legacy()).copy()
    depth[depth > 5000] = 0
    return o3d.t.geometry.Image(depth), np.loadtxt(stem + ".pose.txt")


def fuse(frames, voxel):
    grid = o3d.t.geometry.VoxelBlockGrid(("tsdf", "weight"), (o3c.float32, o3c.float32), ((1), (1)), voxel, 8, 20000)
    start = time.process_time()
    for depth, pose in frames:
        extrinsic = o3c.Tensor(np.linalg.inv(pose))
        blocks = grid.compute_unique_block_coordinates(depth, K, extrinsic, 1000.0, 5.0, 4.0)
        grid.integrate(blocks, depth, K, extrinsic, 1000.0, 5.0, 4.0)
    return (time.process_time() - start) * 1e3 / len(frames), grid


def cast(grid, depth, pose):
    extrinsic = o3c.Tensor(np.linalg.inv(pose))
    # The blocks around the measured surface, as Open3D's own examples do; with all blocks its range map overflows and crashes.
    blocks = grid.compute_unique_block_coordinates(depth, K, extrinsic, 1000.0, 5.0, 4.0)
    start = time.process_time()
    out = grid.ray_cast(blocks, K, extrinsic, 640, 480, ["depth", "normal"], 1000.0, 0.3, 6.0, 1.0, 4.0)
    return (time.process_time() - start) * 1e3, out["depth"].numpy()[..., 0] / 1000.0


def turned(k):
    """The frame of a submap: any rotation, and up to two metres along each axis, as in crates/dense/tests/common/pairs.rs."""
    v = [((k * 7919 + i * 104729) % 1000) / 1000 - 0.5 for i in range(1, 7)]
    out = np.eye(4)
    out[:3, :3] = o3d.geometry.get_rotation_matrix_from_axis_angle(np.array(v[:3]) * 6.0)
    out[:3, 3] = np.array(v[3:]) * 4.0
    return out


def blocks_of(grid, image, pose):
    found = grid.compute_unique_block_coordinates(image, K, o3c.Tensor(np.linalg.inv(pose)), 1000.0, 5.0, 4.0)
    return set(map(tuple, found.numpy().tolist()))


def submap(first):
    """A second of the recording: its points at 2 cm in a frame of its own, that frame, a place seen, and its blocks."""
    images = [frame(n) for n in range(first, first + 30, 3)]
    _, grid = fuse(images, 0.02)
    frame_from_world = turned(first)
    points = grid.extract_point_cloud(weight_threshold=1.0).to_legacy().transform(frame_from_world)
    seen = (images[0][1] @ np.array([0, 0, 2.0, 1.0]))
    return points, frame_from_world, seen, [blocks_of(grid, d, p) for d, p in images]


def registered(target, source, cell):
    """FPFH, fast global registration, then points to planes; features included in the time."""
    reg = o3d.pipelines.registration
    start = time.process_time()
    clouds, features = [], []
    for points in (target, source):
        cloud = points.voxel_down_sample(cell)
        clouds.append(cloud)
        features.append(reg.compute_fpfh_feature(cloud, o3d.geometry.KDTreeSearchParamHybrid(5 * cell, 100)))
    option = reg.FastGlobalRegistrationOption(maximum_correspondence_distance=0.5 * cell)
    found = reg.registration_fgr_based_on_feature_matching(clouds[1], clouds[0], features[1], features[0], option)
    plane = reg.TransformationEstimationPointToPlane()
    found = reg.registration_icp(clouds[1], clouds[0], cell, found.transformation, plane)
    return found.transformation, (time.process_time() - start) * 1e3


def registration():
    """The twenty pairs of submaps whose overlap is nearest to 45 %, right within 10 cm and 3.5 degrees."""
    submaps = [submap(first) for first in range(0, 271, 15)]
    pairs = []
    for a in range(len(submaps)):
        known = set.union(*submaps[a][3])
        for b in range(a + 1, len(submaps)):
            overlap = np.mean([len(known & own) / max(len(own), 1) for own in submaps[b][3]])
            pairs.append((abs(overlap - 0.45), a, b))
    right, times = 0, []
    for _, a, b in sorted(pairs)[:20]:
        (target, target_frame, _, _), (source, source_frame, seen, _) = submaps[a], submaps[b]
        runs = [registered(target, source, 0.1) for _ in range(3)]
        times.append(min(r[1] for r in runs))
        off = np.linalg.inv(target_frame @ np.linalg.inv(source_frame)) @ runs[-1][0]
        there = source_frame @ seen
        angle = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
        right += np.linalg.norm((off @ there - there)[:3]) < 0.1 and angle < 3.5
    print(f"registration at 10 cm: {right} of 20 right, {np.median(times):.0f} ms (median), {max(times):.0f} ms (longest)")


def main():
    if "fields" not in sys.argv:
        registration()
    if "registration" not in sys.argv:
        fields()


def fields():
    frames = [frame(n) for n in range(0, 300, 5)]
    held_out = [frame(n) for n in range(12, 300, 25)]
    print(f"Open3D {o3d.__version__}, {len(frames)} frames, one thread")
    for voxel in (0.05, 0.02, 0.01):
        runs = [fuse(frames, voxel) for _ in range(3)]
        grid = runs[-1][1]
        print(f"TSDF {voxel * 100:.0f} cm: {min(r[0] for r in runs):.2f} ms a frame, {grid.hashmap().size()} blocks")
        mesh_ms = []
        for _ in range(3):
            start = time.process_time()
            mesh = grid.extract_triangle_mesh(weight_threshold=1.0)
            mesh_ms.append((time.process_time() - start) * 1e3)
        print(f"mesh {voxel * 100:.0f} cm: {min(mesh_ms):.1f} ms, {len(mesh.triangle.indices)} triangles")
        errors, times, measured = [], [], 0
        for depth, pose in held_out:
            ms, z = cast(grid, depth, pose)
            times.append(ms)
            truth = depth.as_tensor().numpy()[..., 0] / 1000.0
            measured += (truth > 0).sum()
            both = (z > 0) & (truth > 0)
            errors.append(np.abs(z - truth)[both])
        errors = np.concatenate(errors)
        print(
            f"held-out depth {voxel * 100:.0f} cm: median {np.median(errors) * 1e3:.2f} mm, "
            f"{(errors < 0.05).mean() * 100:.1f} % within 5 cm, of {len(errors) / measured * 100:.1f} % of the measured pixels; "
            f"ray cast {min(times):.0f} ms"
        )


if __name__ == "__main__":
    main()
