#!/usr/bin/env python3
"""Open3D's tensor TSDF on the frames of `cargo bench -p cairn-dense --bench dense`: times, held-out depth, mesh, ray cast.

Needs `pip install open3d==0.20.0` (a virtual environment outside the checkout) and, on Debian, libusb-1.0-0 and libgl1.
Times are processor time of one thread, the least of three passes. Usage: compare_dense.py [DATA_FOLDER]
"""
import os
import sys
import time

os.environ["OMP_NUM_THREADS"] = "1"
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import numpy as np
import open3d as o3d
import open3d.core as o3c

DATA = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("CAIRN_DATA", "../shared/data")
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


def main():
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
