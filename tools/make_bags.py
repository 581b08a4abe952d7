#!/usr/bin/env python3
"""Writes a recording in EuRoC layout as bags of every kind that `cairn run` reads.

    python3 -m venv /tmp/bags && /tmp/bags/bin/pip install rosbags mcap numpy pillow pyyaml
    /tmp/bags/bin/python tools/make_bags.py FOLDER OUT [--frames N] [--raw]

FOLDER has mav0/ with cam0, cam1 and imu0. With --raw the images are decoded to mono8, else the JPEG or PNG files are stored
as they are (sensor_msgs/CompressedImage). Written are OUT/ros1-{none,bz2,lz4}.bag, OUT/ros2-{db3,mcap}/,
OUT/mcap-{none,lz4,zstd}.mcap and OUT/ros1-in.mcap, each with camera_info and tf_static.
The writers are `rosbags` and `mcap` of the Python registry: this project's readers share no code with them.
"""

import argparse
import csv
import shutil
from pathlib import Path

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
arguments.add_argument("folder", type=Path)
arguments.add_argument("out", type=Path)
arguments.add_argument("--frames", type=int)
arguments.add_argument("--raw", action="store_true")
a = arguments.parse_args()
root = a.folder / "mav0" if (a.folder / "mav0").is_dir() else a.folder
a.out.mkdir(parents=True, exist_ok=True)


def rows(path):
    with open(path) as file:
        return [row for row in csv.reader(file) if row and not row[0].startswith("#")]


def stamp(store, ns):
    return store.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)


def header(store, ns, frame):
    fields = {"stamp": stamp(store, ns), "frame_id": frame}
    kind = store.types["std_msgs/msg/Header"]
    return kind(seq=0, **fields) if "seq" in kind.__dataclass_fields__ else kind(**fields)


def quaternion(r):
    """x, y, z, w of a rotation matrix, by the largest of the four (Shepperd 1978)."""
    t = np.array([r[0, 0], r[1, 1], r[2, 2], np.trace(r)])
    i = int(np.argmax(t))
    if i == 3:
        q = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + t[3]]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [0.0] * 4
        q[i] = 1 - t[3] + 2 * r[i, i]
        q[j] = r[i, j] + r[j, i]
        q[k] = r[i, k] + r[k, i]
        q[3] = r[k, j] - r[j, k]
    return np.array(q) / np.linalg.norm(q)


def messages(store, ros1):
    """Topic, type, time and message of everything, in order of time."""
    kinds = store.types
    out = []
    transforms = []
    for name in ("cam0", "cam1"):
        about = yaml.safe_load((root / name / "sensor.yaml").read_text())
        t = np.array(about["T_BS"]["data"], dtype=float).reshape(4, 4)
        fx, fy, cx, cy = about["intrinsics"]
        k = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], dtype=float)
        d = np.array(list(about["distortion_coefficients"]) + [0.0], dtype=float)
        w, h = about["resolution"]
        q = quaternion(t[:3, :3])
        transforms.append((name, t[:3, 3], q))
        images = rows(root / name / "data.csv")[: a.frames]
        first = int(images[0][0])
        upper = ros1
        matrices = dict(
            [("D" if upper else "d", d), ("K" if upper else "k", k), ("R" if upper else "r", np.eye(3).ravel()),
             ("P" if upper else "p", np.hstack([k.reshape(3, 3), np.zeros((3, 1))]).ravel())])
        roi = kinds["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        info = kinds["sensor_msgs/msg/CameraInfo"](
            header=header(store, first, name), height=h, width=w, distortion_model="plumb_bob", binning_x=0,
            binning_y=0, roi=roi, **matrices)
        out.append((f"/{name}/camera_info", "sensor_msgs/msg/CameraInfo", first, info))
        for row in images:
            ns, path = int(row[0]), root / name / "data" / row[1].strip()
            if a.raw:
                from PIL import Image

                pixels = np.asarray(Image.open(path).convert("L"))
                image = kinds["sensor_msgs/msg/Image"](
                    header=header(store, ns, name), height=pixels.shape[0], width=pixels.shape[1], encoding="mono8",
                    is_bigendian=0, step=pixels.shape[1], data=pixels.ravel())
                out.append((f"/{name}/image_raw", "sensor_msgs/msg/Image", ns, image))
            else:
                data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
                image = kinds["sensor_msgs/msg/CompressedImage"](
                    header=header(store, ns, name), format=path.suffix[1:].replace("jpg", "jpeg"), data=data)
                out.append((f"/{name}/image_raw/compressed", "sensor_msgs/msg/CompressedImage", ns, image))
        last = int(images[-1][0])
    vector, turn = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    transforms = [
        kinds["geometry_msgs/msg/TransformStamped"](
            header=header(store, first, "imu"), child_frame_id=name,
            transform=kinds["geometry_msgs/msg/Transform"](
                translation=vector(x=t[0], y=t[1], z=t[2]), rotation=turn(x=q[0], y=q[1], z=q[2], w=q[3])))
        for name, t, q in transforms
    ]
    out.append(("/tf_static", "tf2_msgs/msg/TFMessage", first, kinds["tf2_msgs/msg/TFMessage"](transforms=transforms)))
    for row in rows(root / "imu0" / "data.csv"):
        ns = int(row[0])
        if ns > last + 10**8:
            break
        g, f = [float(v) for v in row[1:4]], [float(v) for v in row[4:7]]
        imu = kinds["sensor_msgs/msg/Imu"](
            header=header(store, ns, "imu"), orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.array([-1.0] + [0.0] * 8), angular_velocity=vector(x=g[0], y=g[1], z=g[2]),
            angular_velocity_covariance=np.zeros(9), linear_acceleration=vector(x=f[0], y=f[1], z=f[2]),
            linear_acceleration_covariance=np.zeros(9))
        out.append(("/imu0", "sensor_msgs/msg/Imu", ns, imu))
    return sorted(out, key=lambda m: m[2])


ros1 = get_typestore(Stores.ROS1_NOETIC)
ros1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
all1 = [(topic, kind, ns, bytes(ros1.serialize_ros1(m, kind))) for topic, kind, ns, m in messages(ros1, True)]
for name, compression in (("none", None), ("bz2", Writer1.CompressionFormat.BZ2), ("lz4", Writer1.CompressionFormat.LZ4)):
    path = a.out / f"ros1-{name}.bag"
    path.unlink(missing_ok=True)
    writer = Writer1(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for topic, kind, ns, data in all1:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ros1)
            writer.write(connections[topic], ns, data)
    print(path, path.stat().st_size, "bytes")

ros2 = get_typestore(Stores.ROS2_HUMBLE)
all2 = [(topic, kind, ns, bytes(ros2.serialize_cdr(m, kind))) for topic, kind, ns, m in messages(ros2, False)]
for name, plugin in (("db3", StoragePlugin.SQLITE3), ("mcap", StoragePlugin.MCAP)):
    path = a.out / f"ros2-{name}"
    shutil.rmtree(path, ignore_errors=True)
    with Writer2(path, version=8, storage_plugin=plugin) as writer:
        connections = {}
        for topic, kind, ns, data in all2:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ros2)
            writer.write(connections[topic], ns, data)
    print(path)

for name, compression, profile, encoding, everything, store in (
    ("mcap-none", CompressionType.NONE, "ros2", "cdr", all2, ros2),
    ("mcap-lz4", CompressionType.LZ4, "ros2", "cdr", all2, ros2),
    ("mcap-zstd", CompressionType.ZSTD, "ros2", "cdr", all2, ros2),
    ("ros1-in", CompressionType.LZ4, "ros1", "ros1", all1, ros1),
):
    path = a.out / f"{name}.mcap"
    with open(path, "wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start(profile=profile, library="make_bags")
        channels = {}
        for topic, kind, ns, data in everything:
            if topic not in channels:
                text, _ = store.generate_msgdef(kind, ros_version=1 if encoding == "ros1" else 2)
                kind = kind.replace("/msg/", "/") if encoding == "ros1" else kind
                schema = writer.register_schema(kind, "ros1msg" if encoding == "ros1" else "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], ns, data, ns)
        writer.finish()
    print(path, path.stat().st_size, "bytes")
