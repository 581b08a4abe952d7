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
# A small robot: the recording hardly moves, and little ground is known to be free.
RADIUS_M = 0.08


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
    child = node(*flags, "--plan", "--base-from-camera", 0, 0, 1.0, -0.5, 0.5, -0.5, 0.5, "--robot-radius-m", RADIUS_M)
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
    path = [(seconds(m.header), m.pose.pose.position) for _, m in out["/pose"]]
    path = [(t, [q.x, q.y, q.z]) for t, q in path if t >= started]
    # The base turns about the camera: it is compared at the camera.
    turned = [m.pose.pose.orientation for _, m in out["/pose"] if seconds(m.header) >= started]
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
    check_plan(wire, child, grid, out)
    assert child.end() == 0


def check_plan(wire, child, grid, out):
    """A goal as a viewer sets it, on free ground and in a wall; the path keeps off what is in the grid."""
    plans = wire.listen("/cairn/plan", "nav_msgs/msg/Path")
    goal = wire.writer("/cairn/goal_pose", "geometry_msgs/msg/PoseStamped", reliable=True)
    message = grid[-1][1]
    info, cells = message.info, np.array(message.data).reshape(message.info.height, message.info.width)
    origin, q = info.origin.position, info.origin.orientation
    assert abs(q.w - 1) < 1e-9 and message.header.frame_id == "map"
    place = lambda row, column: (origin.x + (column + 0.5) * info.resolution, origin.y + (row + 0.5) * info.resolution)  # noqa: E731
    here = out["/pose"][-1][1].pose.pose.position
    # Free ground with free ground around it, as far from here as there is.
    open_ground, reach = cells == 0, 4
    room = np.ones_like(open_ground)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            room &= np.roll(open_ground, (i, j), (0, 1))
    room[:reach], room[-reach:], room[:, :reach], room[:, -reach:] = False, False, False, False
    spots = [place(r, c) for r, c in np.argwhere(room)]
    assert spots, "there is open ground"

    def ask(x, y, frame="map"):
        sent = make("geometry_msgs/msg/PoseStamped", header=header(0, frame))
        sent.pose.position.x, sent.pose.position.y, sent.pose.orientation.w = x, y, 1.0
        goal(sent)

    found = None
    for x, y in sorted(spots, key=lambda s: -np.hypot(s[0] - here.x, s[1] - here.y))[:: max(1, len(spots) // 30)]:
        if np.hypot(x - here.x, y - here.y) < 0.4:
            break
        # A goal that is sent before the node's reader has been discovered is lost, as with any writer that keeps nothing.
        before = len(plans)
        assert any(ask(x, y) or until(lambda: len(plans) > before, 2) for _ in range(3)), child.lines
        if plans[-1][1].poses:
            found = (x, y)
            break
    assert found, child.lines
    points = np.array([[p.pose.position.x, p.pose.position.y] for p in plans[-1][1].poses])
    assert np.hypot(*(points[0] - [here.x, here.y])) < 0.1 and np.hypot(*(points[-1] - found)) < 1e-6
    walls = np.array([place(r, c) for r, c in np.argwhere(cells == 100)])
    least = min(np.hypot(*(walls - p).T).min() for p in points[1:])
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    print(f"plan of {length:.2f} m in {len(points)} poses, {least:.2f} m from the nearest wall")
    assert least > RADIUS_M and plans[-1][1].header.frame_id == "map"
    wall = walls[np.hypot(*(walls - [here.x, here.y]).T).argmax()]
    before = len(plans)
    ask(*wall)
    assert until(lambda: child.said("no path to the goal") and len(plans) > before and not plans[-1][1].poses, 5), child.lines
    ask(0, 0, "nowhere")
    assert until(lambda: child.said('a goal in the frame "nowhere" is not known'), 5), child.lines
