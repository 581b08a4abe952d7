#!/usr/bin/env python3
"""Compares Cairn's trajectory evaluation with evo's, number by number.

    pip install evo
    python3 tools/compare_with_evo.py [--data DIR] [--cairn "COMMAND"]

For each pair of trajectories in DIR/eval, each alignment and each metric, both programs run as child
processes and every statistic is compared. Prints one row per metric and ends with the largest
difference; exit code 1 when that is above the tolerance. `--golden` prints evo's numbers alone, in
the form that crates/eval/tests/suite/evo_golden.rs holds.
"""

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
STATISTICS = ["rmse", "mean", "median", "std", "min", "max"]

# (name, evo's file kind, reference, estimate)
PAIRS = [
    ("kitti00", "kitti", "KITTI_00_gt.txt", "KITTI_00_ORB.txt"),
    ("fr2_desk", "tum", "fr2_desk_groundtruth.txt", "fr2_desk_ORB.txt"),
    ("fr2_desk_kf_mono", "tum", "fr2_desk_groundtruth.txt", "fr2_desk_ORB_kf_mono.txt"),
    ("v102", "euroc", "V102_groundtruth.csv", "V102.txt"),
]
ALIGNMENTS = {"none": [], "se3": ["-a"], "sim3": ["-a", "-s"]}

# (name, evo program and options, cairn options, key of cairn's JSON)
METRICS = [
    ("ate m", ["ape", "-r", "trans_part"], [], "ate_m"),
    ("ate deg", ["ape", "-r", "angle_deg"], [], "ate_deg"),
    ("rpe m, 1 frame", ["rpe", "-r", "trans_part"], [], "rpe_m"),
    ("rpe deg, 1 frame", ["rpe", "-r", "angle_deg"], [], "rpe_deg"),
    ("rpe m, 10 frames all", ["rpe", "-r", "trans_part", "-d", "10", "--all_pairs"],
     ["--delta", "10f", "--all-pairs"], "rpe_m"),
    ("rpe m, 1 m", ["rpe", "-r", "trans_part", "-d", "1", "-u", "m"], ["--delta", "1m"], "rpe_m"),
    ("rpe deg, 1 m", ["rpe", "-r", "angle_deg", "-d", "1", "-u", "m"], ["--delta", "1m"], "rpe_deg"),
    ("rpe m, 5 m all", ["rpe", "-r", "trans_part", "-d", "5", "-u", "m", "--all_pairs"],
     ["--delta", "5m", "--all-pairs"], "rpe_m"),
]


def run_evo(kind, reference, estimate, align, options, max_difference):
    """Statistics and the number of values from evo, as a dictionary; None when it refuses."""
    program, rest = options[0], options[1:]
    with tempfile.TemporaryDirectory() as folder:
        result = os.path.join(folder, "result.zip")
        command = ["evo_" + program, kind, reference, estimate, *align, *rest,
                   "--save_results", result, "--no_warnings"]
        if kind != "kitti":
            command += ["--t_max_diff", str(max_difference)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            return None
        with zipfile.ZipFile(result) as archive:
            statistics = json.loads(archive.read("stats.json"))
            with archive.open("error_array.npy") as errors:
                header = errors.read(256)
    shape = header.split(b"'shape': (")[1].split(b",")[0]
    statistics["count"] = int(shape)
    return statistics


def run_cairn(command, reference, estimate, align, options, max_difference):
    """Cairn's evaluation as a dictionary; None when it refuses."""
    done = subprocess.run([*command, reference, estimate, "--align", align, "--max-difference",
                           str(max_difference), "--json", *options], capture_output=True, text=True, cwd=ROOT)
    if done.returncode != 0:
        print(done.stderr.strip(), file=sys.stderr)
        return None
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", default=os.environ.get("CAIRN_DATA", os.path.join(ROOT, "..", "shared", "data")))
    parser.add_argument("--cairn", default="cargo run -q --release -p cairn-eval --example evaluate --",
                        help="the command that evaluates; `cairn eval` once it is installed")
    parser.add_argument("--max-difference", type=float, default=0.01, help="seconds")
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--golden", action="store_true", help="print evo's numbers alone")
    args = parser.parse_args()
    folder = os.path.abspath(os.path.join(args.data, "eval"))
    if not os.path.isdir(folder):
        print(f"skipped: no folder {folder}")
        return 0
    if shutil.which("evo_ape") is None:
        print("evo is not installed: pip install evo", file=sys.stderr)
        return 1
    worst, rows, missing = 0.0, 0, 0
    if not args.golden:
        print(f"{'pair':<18}{'align':<6}{'metric':<22}{'count':>7}{'evo rmse':>16}{'cairn rmse':>16}{'worst diff':>12}")
    for pair, kind, reference, estimate in PAIRS:
        reference, estimate = os.path.join(folder, reference), os.path.join(folder, estimate)
        for align, flags in ALIGNMENTS.items():
            for name, evo_options, cairn_options, key in METRICS:
                evo = run_evo(kind, reference, estimate, flags, evo_options, args.max_difference)
                if args.golden:
                    numbers = ", ".join(repr(evo[s]) for s in STATISTICS)
                    print(f'("{pair}", "{align}", "{name}", {evo["count"]}, [{numbers}]),', flush=True)
                    continue
                cairn = run_cairn(shlex.split(args.cairn), reference, estimate, align, cairn_options,
                                  args.max_difference)
                ours = cairn and cairn.get(key)
                if not evo or not ours:
                    print(f"{pair:<18}{align:<6}{name:<22} missing: evo {bool(evo)}, cairn {bool(ours)}")
                    missing += 1
                    continue
                difference = max(abs(evo[s] - ours[s]) for s in STATISTICS)
                if evo["count"] != ours["count"]:
                    difference = float("inf")
                worst, rows = max(worst, difference), rows + 1
                print(f"{pair:<18}{align:<6}{name:<22}{ours['count']:>7}{evo['rmse']:>16.9f}"
                      f"{ours['rmse']:>16.9f}{difference:>12.1e}", flush=True)
    if args.golden:
        return 0
    print(f"{rows} comparisons of {len(STATISTICS)} statistics, largest difference {worst:.2e}, missing {missing}")
    return 0 if rows and not missing and worst <= args.tolerance else 1


if __name__ == "__main__":
    sys.exit(main())
