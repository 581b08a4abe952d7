#!/usr/bin/env python3
"""Distance transform and grid search of other libraries on the map that `cargo bench -p cairn-plan --bench figures` uses.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install numpy scipy opencv-python-headless tcod
    /tmp/venv/bin/python tools/compare_plan.py ../shared/data/grids

Prints one line for each library: the least of some runs, in milliseconds that the process ran, one thread. Run it beside the
bench on the same machine. Paths are checked: a diagonal step between two blocked cells is a cut corner.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
import scipy.ndimage
import tcod


def read_pgm(path):
    data = path.read_bytes()
    fields, at = [], 2
    while len(fields) < 3:
        while data[at:at + 1].isspace():
            at += 1
        if data[at:at + 1] == b"#":
            at = data.index(b"\n", at)
            continue
        end = at
        while not data[end:end + 1].isspace():
            end += 1
        fields.append(int(data[at:end]))
        at = end
    width, height, _ = fields
    return np.frombuffer(data, np.uint8, width * height, at + 1).reshape(height, width)[::-1]


def least(run, times=15):
    best = float("inf")
    for _ in range(times):
        began = time.process_time()
        run()
        best = min(best, time.process_time() - began)
    return best * 1e3


def cut_corners(free, path):
    return sum(
        1
        for (a, b) in zip(path[:-1], path[1:])
        if a[0] != b[0] and a[1] != b[1] and not (free[a[0], b[1]] and free[b[0], a[1]])
    )


def main():
    cv2.setNumThreads(1)
    pixels = read_pgm(Path(sys.argv[1]) / "willow-2010-02-18-0.10.pgm")
    # As map_server reads it: free where (255 - x) / 255 < 0.196.
    free = np.repeat(np.repeat((255 - pixels.astype(float)) / 255 < 0.196, 2, axis=0), 2, axis=1)
    print(f"{free.shape[1]} x {free.shape[0]} cells, {free.sum()} free")
    image = free.astype(np.uint8)
    distance = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    exact = scipy.ndimage.distance_transform_edt(free)
    print(f"distance transform: OpenCV {cv2.__version__} precise "
          f"{least(lambda: cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)):.2f} ms, "
          f"SciPy {scipy.__version__} {least(lambda: scipy.ndimage.distance_transform_edt(free), 5):.2f} ms; "
          f"they differ by {np.abs(distance - exact).max():.1e} cells at most")
    window = np.ascontiguousarray(image[508:708, 466:666])
    print(f"window of 200 x 200: OpenCV {least(lambda: cv2.distanceTransform(window, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), 200):.4f} ms")
    inflated = exact >= 4
    labels, _ = scipy.ndimage.label(inflated)
    largest = np.argmax(np.bincount(labels.ravel())[1:]) + 1
    cells = np.argwhere(labels == largest)
    random = np.random.default_rng(7)
    cost = inflated.astype(np.int8)
    # tcod takes whole costs: 70 and 99 are the nearest small ones.
    times, cut, length = [], 0, 0.0
    for _ in range(40):
        start, goal = cells[random.integers(len(cells), size=2)]
        best = float("inf")
        for _ in range(2):
            began = time.process_time()
            graph = tcod.path.SimpleGraph(cost=cost, cardinal=70, diagonal=99)
            finder = tcod.path.Pathfinder(graph)
            finder.add_root(tuple(start))
            path = finder.path_to(tuple(goal))
            best = min(best, time.process_time() - began)
        times.append(best * 1e3)
        cut += cut_corners(inflated, path)
        steps = np.diff(path, axis=0)
        length += np.hypot(steps[:, 0], steps[:, 1]).sum()
    print(f"search, inflated by 0.2 m: tcod {tcod.__version__} A* mean {np.mean(times):.2f}, median {np.median(times):.2f}, "
          f"max {np.max(times):.2f} ms over {len(times)} pairs, {length / len(times):.1f} cells in the mean, "
          f"{cut} corners cut")


if __name__ == "__main__":
    main()
