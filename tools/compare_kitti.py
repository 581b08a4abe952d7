#!/usr/bin/env python3
"""Compares Cairn's figures of the KITTI odometry benchmark with those of two other programs.

    pip install evo==1.38.1 kiss-icp==1.3.0
    python3 tools/compare_kitti.py [--data DIR] [--cairn "COMMAND"]

kiss-icp has the metric of the benchmark's development kit. evo has not; but its relative poses over the kit's segments give
the same figures: 100 to 800 m along the reference, from every tenth frame, to the first frame beyond. KITTI 00 in DIR/eval with
ORB-SLAM2's result, and the same with a wrong unit and with a drift. Exit code 1 when a difference is above 1e-5 of the value, or 1e-3
for the rotation of kiss-icp: it takes the angle from the trace of the matrices, which the six digits of the files make inexact.
"""

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile

import numpy as np
from evo.core import lie_algebra
from kiss_icp.metrics import sequence_error

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LENGTHS = range(100, 900, 100)


def poses(rows):
    """4x4 matrices of rows of 12 numbers."""
    out = np.tile(np.eye(4), (len(rows), 1, 1))
    out[:, :3] = rows.reshape(-1, 3, 4)
    return out


def by_evo(truth, estimate):
    """Percent and degrees per 100 m by evo's relative poses."""
    path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])
    metres, degrees = [], []
    for first in range(0, len(truth), 10):
        for length in LENGTHS:
            last = int(np.searchsorted(path, path[first] + length, side="right"))
            if last >= len(truth):
                continue
            moved = [lie_algebra.relative_se3(p[first], p[last]) for p in (truth, estimate)]
            off = lie_algebra.relative_se3(*moved)
            metres.append(np.linalg.norm(off[:3, 3]) / length)
            degrees.append(np.degrees(lie_algebra.so3_log_angle(off[:3, :3])) / length)
    return 100 * np.mean(metres), 100 * np.mean(degrees)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", default=os.environ.get("CAIRN_DATA", os.path.join(ROOT, "..", "shared", "data")))
    parser.add_argument("--cairn", default="cargo run -q --release -p cairn-eval --example evaluate --",
                        help="the command that evaluates; `cairn eval` once it is installed")
    args = parser.parse_args()
    truth_file, estimate_file = (os.path.abspath(os.path.join(args.data, "eval", f"KITTI_00_{n}.txt")) for n in ("gt", "ORB"))
    if not os.path.isfile(truth_file):
        print(f"skipped: no file {truth_file}")
        return 0
    truth, estimate = np.loadtxt(truth_file), np.loadtxt(estimate_file)
    wrong_unit = estimate.copy()
    wrong_unit[:, 3::4] *= 1.03
    drift = estimate.copy()
    turned = poses(drift)
    for k, pose in enumerate(turned):
        pose[:3, :3] = pose[:3, :3] @ lie_algebra.so3_exp(np.array([0.0, 2e-5 * k, 0.0]))
    drift[:] = turned[:, :3].reshape(-1, 12)
    good = True
    print(f"{'estimate':<12}{'program':<10}{'percent':>12}{'deg/100 m':>12}")
    for name, rows in (("ORB-SLAM2", estimate), ("wrong unit", wrong_unit), ("turning", drift)):
        with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
            np.savetxt(file, rows)
            file.flush()
            command = [*shlex.split(args.cairn), truth_file, file.name, "--json"]
            cairn = json.loads(subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True).stdout)["kitti"]
        ours = (cairn["translation_percent"], cairn["rotation_deg_per_100m"])
        percent, rate = sequence_error(poses(truth), poses(rows))
        others = {"kiss-icp": (percent, 100 * rate), "evo": by_evo(poses(truth), poses(rows))}
        print(f"{name:<12}{'cairn':<10}{ours[0]:>12.6f}{ours[1]:>12.6f}")
        for program, theirs in others.items():
            print(f"{name:<12}{program:<10}{theirs[0]:>12.6f}{theirs[1]:>12.6f}")
            off = [abs(a / b - 1) for a, b in zip(theirs, ours)]
            good &= off[0] < 1e-5 and off[1] < (1e-3 if program == "kiss-icp" else 1e-5)
    print("they agree" if good else "they differ")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
