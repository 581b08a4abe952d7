#!/usr/bin/env python3
"""Reads a grid that `cairn map export --grid` or a robot saved, as the documentation of ROS map_server says, and compares it with Cairn.

    python3 -m venv /tmp/grid && /tmp/grid/bin/pip install pyyaml pillow
    /tmp/grid/bin/python tools/check_grid.py ground.yaml [CAIRN]

PyYAML and Pillow read the files. Printed are the counts of free, occupied and unknown cells and the size in metres. Then `cairn plan`
(target/release/cairn, or CAIRN) is asked for ways of no length: in the middle of 200 cells drawn at random it must find those free that
this reader does, and those blocked that it finds occupied or unknown. Exits with 1 where they differ."""

import json
import math
import random
import subprocess
import sys
from pathlib import Path

import yaml
from PIL import Image


def read(path):
    """Cells from the lower left, row by row, as 0, 100 and -1; width, resolution, origin."""
    about = yaml.safe_load(path.read_text())
    image = Image.open(path.parent / about["image"]).convert("L")
    width, height = image.size
    shown = image.tobytes()
    cells = []
    for y in reversed(range(height)):
        for x in range(width):
            value = shown[y * width + x]
            p = value / 255 if about["negate"] else (255 - value) / 255
            cells.append(100 if p > about["occupied_thresh"] else 0 if p < about["free_thresh"] else -1)
    return cells, width, about["resolution"], about["origin"]


def main():
    path = Path(sys.argv[1])
    cairn = sys.argv[2] if len(sys.argv) > 2 else str(Path(__file__).parent.parent / "target/release/cairn")
    cells, width, resolution, (x0, y0, yaw) = read(path)
    height = len(cells) // width
    counts = {name: cells.count(v) for name, v in [("free", 0), ("occupied", 100), ("unknown", -1)]}
    print(f"{width * resolution:.2f} x {height * resolution:.2f} m in cells of {resolution} m: {counts}")
    wrong = 0
    chosen = random.Random(1).sample(range(len(cells)), min(200, len(cells)))
    for k in chosen:
        u, v = (k % width + 0.5) * resolution, (k // width + 0.5) * resolution
        at = f"{x0 + math.cos(yaw) * u - math.sin(yaw) * v:.6f},{y0 + math.sin(yaw) * u + math.cos(yaw) * v:.6f}"
        command = [cairn, "plan", str(path), f"--from={at}", f"--to={at}", "--radius", "0", "--margin", "0", "--search", "astar", "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        found = done.returncode == 0 and "error" not in json.loads(done.stdout)
        if found != (cells[k] == 0):
            wrong += 1
            print(f"{at}: {cells[k]} here, `{' '.join(command)}` says {(done.stdout or done.stderr).strip()}")
    print(f"{len(chosen) - wrong} of {len(chosen)} cells alike")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
