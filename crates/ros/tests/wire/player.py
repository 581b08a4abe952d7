"""Plays a EuRoC recording in real time, as drivers would send it."""

import time

import numpy as np


class Player:
    """Publishes left, right and IMU with the stamps of the recording moved to now."""

    def __init__(self, wire, euroc, right=True, imu=True, compressed=False, encoding="mono8"):
        self.euroc, self.right, self.imu, self.compressed, self.encoding = euroc, right, imu, compressed, encoding
        kind = "sensor_msgs/msg/CompressedImage" if compressed else "sensor_msgs/msg/Image"
        end = "/compressed" if compressed else ""
        cameras = ["cam0", "cam1"] if right else ["cam0"]
        self.topics = {"cam0": "/left/image_raw", "cam1": "/right/image_raw"}
        self.images = {name: wire.writer(self.topics[name] + end, kind, depth=5) for name in cameras}
        self.raw = {name: write.of for name, write in self.images.items()}
        info = "sensor_msgs/msg/CameraInfo"
        self.infos = {name: wire.writer(self.topics[name].replace("image_raw", "camera_info"), info) for name in cameras}
        self.readings = wire.writer("/imu", "sensor_msgs/msg/Imu", depth=200) if imu else None
        self.static = wire.writer("/tf_static", "tf2_msgs/msg/TFMessage", reliable=True, latched=True)
        self.static(euroc.static())
        self.sent = {}

    def arguments(self):
        end = "/compressed" if self.compressed else ""
        out = ["--image", self.topics["cam0"] + end]
        if self.right:
            out += ["--right", self.topics["cam1"] + end]
        return out + (["--imu", "/imu"] if self.imu else [])

    def picture(self, name, k):
        return self.euroc.compressed(name, k) if self.compressed else self.euroc.image(name, k, self.encoding)

    def play(self, frames, first=0, rate=1.0, meddle=None):
        """Frames `first` up to `frames`, with the IMU from 1.5 s before: its rate is measured there.

        `meddle(name, k, message)` returns the messages to send instead of one.
        """
        euroc = self.euroc
        begin, end = (int(euroc.images["cam0"][k][0]) for k in (first, frames - 1))
        events = []
        if self.imu:
            begin -= 1_500_000_000
            events += [(r[0], "imu", k) for k, r in enumerate(euroc.readings) if begin <= r[0] <= end + 20_000_000]
        for name in self.images:
            events += [(int(euroc.images[name][k][0]), name, k) for k in range(first, frames)]
        # Reading files takes longer than sending: done before.
        pictures = {(n, k): self.picture(n, k) for n in self.images for k in range(first, frames)}
        started = time.time() + 0.2
        self.shift = int(started * 1e9) - begin
        self.hello(int(started * 1e9))
        for ns, name, k in sorted(events):
            due = started + (ns - begin) * 1e-9 / rate
            time.sleep(max(0.0, due - time.time()))
            message = euroc.imu(k) if name == "imu" else pictures[name, k]
            self.move(message, ns + self.shift)
            for out in [message] if meddle is None else meddle(name, k, message):
                if name == "imu":
                    self.readings(out)
                else:
                    self.images[name](out)
            if name != "imu" and k % 20 == 0:
                self.infos[name](euroc.camera_info(name, ns + self.shift))
            if name == "cam0":
                self.sent[k] = (ns + self.shift, time.time())

    def hello(self, ns):
        for name, info in self.infos.items():
            info(self.euroc.camera_info(name, ns))

    @staticmethod
    def move(message, ns):
        message.header.stamp.sec, message.header.stamp.nanosec = ns // 10**9, ns % 10**9

    def truth(self):
        """Truth in the time that was played."""
        truth = self.euroc.truth.copy()
        truth[:, 0] += self.shift * 1e-9
        return truth


def matrix(q):
    """Rotation of a geometry_msgs/Quaternion."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def pose(position, orientation):
    """4x4 of a position and a quaternion."""
    out = np.eye(4)
    out[:3, :3] = matrix(orientation)
    out[:3, 3] = [position.x, position.y, position.z]
    return out


def ate(times, positions, truth, scale=False):
    """RMSE after alignment (Umeyama 1991), metres; the scale that was found."""
    there = np.stack([np.interp(times, truth[:, 0], truth[:, i]) for i in (1, 2, 3)], axis=1)
    a, b = positions - positions.mean(0), there - there.mean(0)
    u, d, vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.diag([1, 1, np.linalg.det(u) * np.linalg.det(vt)])
    s = np.trace(np.diag(d) @ sign) / (a**2).sum() * len(a) if scale else 1.0
    return float(np.sqrt(((b - s * a @ (u @ sign @ vt).T) ** 2).sum(1).mean())), float(s)
