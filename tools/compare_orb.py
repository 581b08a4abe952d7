#!/usr/bin/env python3
"""Compares Cairn's ORB features with OpenCV's on real recordings.

Needs: pip install opencv-python-headless numpy; a Rust toolchain; recordings in CAIRN_DATA (default ../shared/data).

Both extractors are asked for the same number of features and both sets go through the same matcher (mutual best,
ratio test). A match counts as consistent when it lies within --gate pixels of its epipolar line: the mean of both
images' distances, in undistorted pixels of the original focal length. The epipolar geometry is
the truth's (euroc-mh01, kitti-a), else a robust one from SIFT matches (photos), which favours neither.

Printed per recording and time step: consistent matches per pair, their share, the median epipolar distance of those,
and the same with Cairn's keypoints rounded to whole pixels of their level.
"""

import argparse
import os
import struct
import subprocess
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("CAIRN_DATA", ROOT / "../shared/data"))
FACTOR, LEVELS = 1.2, 8
GRID = (16, 12)


def rotation(w, x, y, z):
    n = np.array([w, x, y, z]) / np.linalg.norm([w, x, y, z])
    w, x, y, z = n
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


class Recording:
    """Images, camera, truth (world_from_camera per image, or None) and the index pairs of each time step."""

    def __init__(self, name, images, K, distortion, poses, steps):
        self.name, self.K, self.distortion, self.poses, self.steps = name, K, distortion, poses, steps
        self.images = images


def camera(fx, fy, cx, cy):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def photos():
    files = sorted((DATA / "photos").glob("*.png"))
    K = camera(520.9, 521.0, 325.1, 249.7)
    distortion = np.array([0.2312, -0.7849, -0.0033, -0.0001, 0.9172])
    n = len(files)
    steps = {0.2: [(i, i + 2) for i in range(n - 2)], 0.5: [(i, i + 5) for i in range(n - 5)]}
    return Recording("photos", files, K, distortion, None, steps)


def kitti():
    folder = DATA / "kitti-a"
    files = sorted(f for f in (folder / "image_0").iterdir() if f.suffix in (".jpg", ".png"))
    first = (folder / "calib.txt").read_text().split("\n")[0].split()[1:]
    K = np.array(first, float).reshape(3, 4)[:, :3]
    poses = [np.vstack([row.reshape(3, 4), [0, 0, 0, 1]]) for row in np.loadtxt(folder / "poses.txt")]
    n = len(files)
    steps = {0.2: [(i, i + 2) for i in range(n - 2)], 0.5: [(i, i + 5) for i in range(n - 5)]}
    return Recording("kitti-a", files, K, np.zeros(5), poses, steps)


def euroc():
    folder = DATA / "euroc-mh01/mav0"
    lines = [l.strip().split(",") for l in (folder / "cam0/data.csv").read_text().split("\n")[1:] if l.strip()]
    stamps = np.array([int(l[0]) for l in lines])
    files = [folder / "cam0/data" / l[1].strip() for l in lines]
    body_from_camera = np.array([
        [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
        [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
        [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949],
        [0, 0, 0, 1.0],
    ])
    truth = np.loadtxt(folder / "state_groundtruth_estimate0/data.csv", delimiter=",", comments="#")
    poses = []
    for stamp in stamps:
        i = int(np.argmin(np.abs(truth[:, 0] - stamp)))
        pose = None
        if abs(truth[i, 0] - stamp) < 3e6:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotation(*truth[i, 4:8]), truth[i, 1:4]
            pose = pose @ body_from_camera
        poses.append(pose)
    steps = {}
    for seconds in (0.2, 0.5):
        pairs = []
        for i in range(0, 280, 5):  # the part that moves
            j = int(np.argmin(np.abs(stamps - (stamps[i] + seconds * 1e9))))
            if poses[i] is not None and poses[j] is not None:
                pairs.append((i, j))
        steps[seconds] = pairs
    K = camera(458.654, 457.296, 367.215, 248.375)
    return Recording("euroc-mh01", files, K, np.array([-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0]), poses, steps)


def cairn_features(binary, images, count, scratch):
    paths = []
    for i, image in enumerate(images):
        path = Path(scratch) / f"{i:05d}.pgm"
        path.write_bytes(b"P5 %d %d 255\n" % (image.shape[1], image.shape[0]) + image.tobytes())
        paths.append(str(path))
    out = Path(scratch) / "features.bin"
    subprocess.run([binary, str(count), str(out), *paths], check=True)
    blob, at, result = out.read_bytes(), 0, []
    row = np.dtype([("xy", "<f4", 2), ("angle", "<f4"), ("response", "<f4"), ("octave", "<u4"), ("bits", "u1", 32)])
    for _ in images:
        (n,) = struct.unpack_from("<I", blob, at)
        rows = np.frombuffer(blob, row, n, at + 4)
        at += 4 + n * row.itemsize
        result.append((rows["xy"].astype(float), rows["bits"].copy(), rows["octave"].astype(int)))
    return result


def opencv_features(images, count):
    orb = cv2.ORB_create(nfeatures=count, scaleFactor=FACTOR, nlevels=LEVELS)
    result, seconds = [], []
    for image in images:
        start = time.perf_counter()
        keypoints, bits = orb.detectAndCompute(image, None)
        seconds.append(time.perf_counter() - start)
        xy = np.array([k.pt for k in keypoints], float).reshape(-1, 2)
        octave = np.array([k.octave for k in keypoints], int)
        result.append((xy, bits if bits is not None else np.zeros((0, 32), np.uint8), octave))
    return result, min(seconds) * 1e3


def whole_pixels(features):
    """The same features, each in the middle of its pixel of its level."""
    out = []
    for xy, bits, octave in features:
        scale = (FACTOR ** octave)[:, None]
        out.append(((np.round((xy + 0.5) / scale - 0.5) + 0.5) * scale - 0.5, bits, octave))
    return out


def match(a, b, ratio):
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2), int)
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    there = {m[0].queryIdx: m[0].trainIdx for m in matcher.knnMatch(a, b, k=2) if m[0].distance < ratio * m[1].distance}
    back = {m.queryIdx: m.trainIdx for m in matcher.match(b, a)}
    return np.array([(i, j) for i, j in there.items() if back.get(j) == i], int).reshape(-1, 2)


def undistort(xy, recording):
    if len(xy) == 0:
        return xy
    return cv2.undistortPoints(xy.reshape(-1, 1, 2), recording.K, recording.distortion, P=recording.K).reshape(-1, 2)


def truth_geometry(recording, i, j):
    b_from_a = np.linalg.inv(recording.poses[j]) @ recording.poses[i]
    R, t = b_from_a[:3, :3], b_from_a[:3, 3]
    skew = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    inverse = np.linalg.inv(recording.K)
    return inverse.T @ skew @ R @ inverse


def robust_geometry(recording, sift, i, j):
    (xa, da), (xb, db) = sift[i], sift[j]
    pairs = [m[0] for m in cv2.BFMatcher().knnMatch(da, db, k=2) if m[0].distance < 0.75 * m[1].distance]
    pa = undistort(xa[[m.queryIdx for m in pairs]], recording)
    pb = undistort(xb[[m.trainIdx for m in pairs]], recording)
    E, _ = cv2.findEssentialMat(pa, pb, recording.K, cv2.USAC_MAGSAC, 0.9999, 1.0)
    inverse = np.linalg.inv(recording.K)
    return inverse.T @ E[:3] @ inverse


def epipolar_distance(F, a, b):
    ha, hb = np.c_[a, np.ones(len(a))], np.c_[b, np.ones(len(b))]
    lines_b, lines_a = ha @ F.T, hb @ F
    error = np.abs((hb * lines_b).sum(1))
    return 0.5 * (error / np.linalg.norm(lines_b[:, :2], axis=1) + error / np.linalg.norm(lines_a[:, :2], axis=1))


def measure(recording, features, pairs, geometry, ratio, gate):
    counts, shares, distances, cells = [], [], [], []
    points = [undistort(f[0], recording) for f in features]
    for (i, j), F in zip(pairs, geometry):
        m = match(features[i][1], features[j][1], ratio)
        d = epipolar_distance(F, points[i][m[:, 0]], points[j][m[:, 1]]) if len(m) else np.zeros(0)
        good = d < gate
        counts.append(good.sum())
        shares.append(good.mean() if len(m) else 0.0)
        distances.append(d[good])
        at = features[i][0][m[good, 0]] / np.array(recording.size) * GRID
        cells.append(len(np.unique(at[:, 1].astype(int) * GRID[0] + at[:, 0].astype(int))))
    return np.mean(counts), np.mean(shares), np.median(np.concatenate(distances)), np.min(counts), np.mean(cells)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features", type=int, default=1000)
    parser.add_argument("--ratio", type=float, default=0.8)
    parser.add_argument("--gate", type=float, default=2.0, help="pixels")
    parser.add_argument("--binary", help="the built example orb_features (default: build it)")
    parser.add_argument("--keep", type=Path, help="leave the images as PGM in this folder, for `cargo bench`")
    parser.add_argument("recordings", nargs="*", default=["photos", "euroc-mh01", "kitti-a"])
    options = parser.parse_args()
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    binary = options.binary
    if not binary:
        subprocess.run(["cargo", "build", "--release", "-q", "-p", "cairn-vision", "--example", "orb_features"], cwd=ROOT, check=True)
        binary = str(ROOT / "target/release/examples/orb_features")
    print(f"{options.features} features, ratio {options.ratio}, gate {options.gate} px; per pair: consistent matches (fewest), share, median distance")
    for name in options.recordings:
        recording = {"photos": photos, "euroc-mh01": euroc, "kitti-a": kitti}[name]()
        needed = sorted({i for pairs in recording.steps.values() for pair in pairs for i in pair})
        images = [cv2.imread(str(recording.images[i]), cv2.IMREAD_GRAYSCALE) for i in needed]
        recording.size = images[0].shape[::-1]
        place = {i: k for k, i in enumerate(needed)}
        with tempfile.TemporaryDirectory() as scratch:
            folder = options.keep / name if options.keep else Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            cairn = cairn_features(binary, images, options.features, folder)
        opencv, fastest = opencv_features(images, options.features)
        sift = None
        if recording.poses is None:
            detector = cv2.SIFT_create(4000)
            sift = {}
            for i in needed:
                keypoints, vectors = detector.detectAndCompute(images[place[i]], None)
                sift[i] = (np.array([k.pt for k in keypoints], float), vectors)
        found = [np.mean([len(f[0]) for f in s]) for s in (cairn, opencv)]
        print(f"{name}: {len(images)} images, features found Cairn {found[0]:.0f}, OpenCV {found[1]:.0f} ({fastest:.2f} ms at best)")
        for seconds, pairs in recording.steps.items():
            if sift is None:
                geometry = [truth_geometry(recording, i, j) for i, j in pairs]
            else:
                geometry = [robust_geometry(recording, sift, i, j) for i, j in pairs]
            pairs = [(place[i], place[j]) for i, j in pairs]
            line = f"  {seconds} s, {len(pairs):3d} pairs:"
            for label, features in (("Cairn", cairn), ("whole pixels", whole_pixels(cairn)), ("OpenCV", opencv)):
                count, share, distance, fewest, cells = measure(recording, features, pairs, geometry, options.ratio, options.gate)
                line += f"  {label} {count:6.1f} ({fewest:3d}) in {cells:5.1f} cells, {share * 100:5.1f} %, {distance:.3f} px"
            print(line)


if __name__ == "__main__":
    main()
