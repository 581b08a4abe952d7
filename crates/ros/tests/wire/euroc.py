"""A EuRoC folder as messages of ROS 2, in order of time."""

import csv
import io
from pathlib import Path

import numpy as np
from messages import header, make
from PIL import Image

# cam0, cam1 as sensor.yaml has them: resolution, intrinsics, distortion, body_from_camera.
FRAMES = {"cam0": "left_optical", "cam1": "right_optical", "imu0": "imu"}


def yaml(path):
    """The sensor.yaml of EuRoC."""
    from ruamel.yaml import YAML

    text = "\n".join(line for line in path.read_text().splitlines() if not line.startswith("%"))
    return YAML(typ="safe").load(text)


def rows(path):
    """Rows of a csv file, without the head."""
    with path.open() as file:
        return [row for row in csv.reader(file) if row and not row[0].startswith("#")]


def quaternion(r):
    """x, y, z, w of a rotation matrix with a trace above -1."""
    w = 0.5 * np.sqrt(1.0 + np.trace(r))
    return np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 4 * w * w]) / (4 * w)


def transform(parent, child, matrix):
    """A geometry_msgs/TransformStamped."""
    x, y, z, w = quaternion(matrix[:3, :3])
    names = ("geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion", "geometry_msgs/msg/Transform")
    translation = make(names[0], x=matrix[0, 3], y=matrix[1, 3], z=matrix[2, 3])
    body = make(names[2], translation=translation, rotation=make(names[1], x=x, y=y, z=z, w=w))
    return make(
        "geometry_msgs/msg/TransformStamped", header=header(0, parent), child_frame_id=child, transform=body
    )


class Euroc:
    """A recording."""

    def __init__(self, folder):
        self.root = Path(folder) / "mav0"
        self.about = {name: yaml(self.root / name / "sensor.yaml") for name in FRAMES}
        self.images = {name: rows(self.root / name / "data.csv") for name in ("cam0", "cam1")}
        self.readings = [(int(r[0]), *map(float, r[1:7])) for r in rows(self.root / "imu0" / "data.csv")]
        truth = rows(self.root / "state_groundtruth_estimate0" / "data.csv")
        # t [s], position of the IMU, orientation w x y z.
        self.truth = np.array([[int(r[0]) * 1e-9, *map(float, r[1:8])] for r in truth])

    def body_from(self, name):
        """The pose of a sensor in the body, which is the IMU."""
        return np.array(self.about[name]["T_BS"]["data"]).reshape(4, 4)

    def static(self):
        """/tf_static: the IMU is the robot's base."""
        names = ("cam0", "cam1")
        transforms = [transform("imu", FRAMES[name], self.body_from(name)) for name in names]
        transforms.append(transform("base_link", "imu", np.eye(4)))
        return make("tf2_msgs/msg/TFMessage", transforms=transforms)

    def camera_info(self, name, ns):
        """The calibration; P without a baseline, so that the pair is found by /tf_static."""
        about = self.about[name]
        fx, fy, cx, cy = about["intrinsics"]
        width, height = about["resolution"]
        return make(
            "sensor_msgs/msg/CameraInfo", header=header(ns, FRAMES[name]), width=width, height=height,
            distortion_model="plumb_bob", d=np.array([*about["distortion_coefficients"], 0.0]),
            k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]), r=np.eye(3).ravel(),
            p=np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0]),
        )  # fmt: skip

    def file(self, name, k):
        """Time and bytes of an image file."""
        ns, file = self.images[name][k]
        return int(ns), (self.root / name / "data" / file.strip()).read_bytes()

    def image(self, name, k, encoding="mono8"):
        """An image as it is sent raw."""
        ns, data = self.file(name, k)
        pixels = np.asarray(Image.open(io.BytesIO(data)).convert("L"))
        if encoding != "mono8":
            pixels = np.repeat(pixels[..., None], 3, axis=2)
        return make(
            "sensor_msgs/msg/Image", header=header(ns, FRAMES[name]), height=pixels.shape[0], width=pixels.shape[1],
            encoding=encoding, step=pixels.strides[0], data=np.ascontiguousarray(pixels).ravel(),
        )  # fmt: skip

    def compressed(self, name, k):
        """The same as a file."""
        ns, data = self.file(name, k)
        return make(
            "sensor_msgs/msg/CompressedImage", header=header(ns, FRAMES[name]), format="jpeg",
            data=np.frombuffer(data, dtype=np.uint8),
        )  # fmt: skip

    def imu(self, k):
        """A reading."""
        ns, *v = self.readings[k]
        vector = lambda x, y, z: make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)  # noqa: E731
        return make(
            "sensor_msgs/msg/Imu", header=header(ns, "imu"), angular_velocity=vector(*v[:3]),
            linear_acceleration=vector(*v[3:]),
        )  # fmt: skip
