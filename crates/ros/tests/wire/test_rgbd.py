"""RGB-D: a Kinect's recording (7-Scenes) with colour pictures and depth in both encodings; the grid comes out."""

import os
import time
from pathlib import Path

import numpy as np
import pytest
from messages import header, make
from PIL import Image
from player import ate
from test_euroc import outputs, seconds
from wire import until

FRAMES = 150


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_kinect(wire, node, encoding):
    folder = Path(os.environ["CAIRN_DATA"]) / "7scenes-kitchen"
    if not folder.exists():
        pytest.skip(f"skipped: {folder} is not there")
    colour = sorted(folder.rglob("frame-*.color.*"))[:FRAMES]
    depth = [next(c.parent.glob(c.name.split(".")[0] + ".depth.*")) for c in colour]
    poses = [np.loadtxt(c.parent / (c.name.split(".")[0] + ".pose.txt")) for c in colour]
    out, grid = outputs(wire), wire.listen("/map", "nav_msgs/msg/OccupancyGrid", latched=True)
    image = "sensor_msgs/msg/Image"
    writers = [wire.writer(name, image, depth=5) for name in ("/kinect/rgb/image_raw", "/kinect/depth/image_raw")]
    infos = [wire.writer(f"/kinect/{name}/camera_info", "sensor_msgs/msg/CameraInfo") for name in ("rgb", "depth")]
    flags = ["--image", "/kinect/rgb/image_raw", "--depth", "/kinect/depth/image_raw"]
    # The robot's base is a metre below the camera, which looks ahead.
    child = node(*flags, "--base-from-camera", 0, 0, 1.0, -0.5, 0.5, -0.5, 0.5)
    k = np.array([585.0, 0, 320, 0, 585, 240, 0, 0, 1])
    p = np.array([585.0, 0, 320, 0, 0, 585, 240, 0, 0, 0, 1, 0])
    frames = []
    for c, d in zip(colour, depth):
        rgb = np.asarray(Image.open(c).convert("RGB"))[..., ::-1]
        mm = np.asarray(Image.open(d)).astype(np.uint16)
        mm = np.where(mm == 65535, 0, mm).astype(np.uint16)
        raw = mm if encoding == "16UC1" else np.where(mm == 0, np.nan, mm * 1e-3).astype(np.float32)
        frames.append((rgb, raw))

    def send(n, ns):
        kinds = (("bgr8", frames[n][0]), (encoding, frames[n][1]))
        for k_, (name, pixels) in enumerate(kinds):
            pixels = np.ascontiguousarray(pixels)
            message = make(
                image, header=header(ns + 4_000_000 * k_, "kinect"), height=480, width=640, encoding=name,
                step=pixels.strides[0], data=pixels.view(np.uint8).ravel(),
            )  # fmt: skip
            writers[k_](message)

    def ready():
        ns = time.time_ns()
        for write in infos:
            write(make("sensor_msgs/msg/CameraInfo", header=header(ns, "kinect"), width=640, height=480, k=k, r=np.eye(3).ravel(), p=p))
        send(0, ns)
        time.sleep(0.05)
        return child.said("Rgbd")

    assert until(ready, 20), child.lines
    truth, started = [], time.time() + 0.2
    for n in range(FRAMES):
        due = started + n / 30
        time.sleep(max(0.0, due - time.time()))
        send(n, int(due * 1e9))
        truth.append([due, *poses[n][:3, 3]])
    time.sleep(2.0)
    path = [(seconds(m.header), m.pose.position) for _, m in out["/pose"]]
    path = [(t, [q.x, q.y, q.z]) for t, q in path if t >= started]
    # The base turns about the camera: it is compared at the camera.
    turned = [m.pose.orientation for _, m in out["/pose"] if seconds(m.header) >= started]
    from player import matrix

    camera = np.array([np.array(q) + matrix(o) @ [0, 0, 1.0] for (_, q), o in zip(path, turned)])
    error, _ = ate(np.array([t for t, _ in path]), camera, np.array(truth))
    assert grid, "a grid is published"
    cells = np.array(grid[-1][1].data)
    info = grid[-1][1].info
    free, occupied = (cells == 0).mean(), (cells == 100).mean()
    values = {v.key: v.value for v in out["/diagnostics"][-1][1].status[0].values}
    print(
        f"{encoding}: ATE {error:.4f} m, {len(path)} of {FRAMES} frames, grid {info.width}x{info.height}, "
        f"{free:.2f} free, {occupied:.2f} occupied; {values}"
    )
    assert error < 0.06 and int(values["frames with a pose"]) > 0.9 * int(values["frames"])
    assert occupied > 0.005 and free > 0.01 and len(cells) == info.width * info.height
    assert child.end() == 0
