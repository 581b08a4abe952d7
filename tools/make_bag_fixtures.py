#!/usr/bin/env python3
"""Writes the small files in crates/bag/tests/data with the libraries that others use.

    python3 -m venv /tmp/bags && /tmp/bags/bin/pip install rosbags mcap numpy
    /tmp/bags/bin/python tools/make_bag_fixtures.py crates/bag/tests/data

Six images of 40x30 pixels at 10 Hz from t = 1000 s (pixel (x, y) of image i is (x + 2 y + 10 i) mod 256) and thirty IMU
samples at 50 Hz (gyro (0.1 i, -0.2, 0.3), accel (0, 9.81, 0.01 i)): small.bag (rosbag1, bz2), small.db3 (SQLite with pages
of 512 bytes, so that rows overflow and the tree has levels), small.mcap (zstd).
"""

import sqlite3
import sys
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_typestore

out = Path(sys.argv[1])
out.mkdir(parents=True, exist_ok=True)


def everything(store):
    kinds = store.types

    def header(ns, frame):
        stamp = kinds["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        kind = kinds["std_msgs/msg/Header"]
        first = {"seq": 7} if "seq" in kind.__dataclass_fields__ else {}
        return kind(stamp=stamp, frame_id=frame, **first)

    vector, turn = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    x, y = np.meshgrid(np.arange(40), np.arange(30))
    messages = []
    for i in range(6):
        ns = 1000 * 10**9 + i * 10**8
        data = ((x + 2 * y + 10 * i) % 256).astype(np.uint8).ravel()
        image = kinds["sensor_msgs/msg/Image"](
            header=header(ns, "cam"), height=30, width=40, encoding="mono8", is_bigendian=0, step=40, data=data)
        messages.append(("/cam/image_raw", "sensor_msgs/msg/Image", ns + 5, image))
    for i in range(30):
        ns = 1000 * 10**9 + i * 2 * 10**7
        imu = kinds["sensor_msgs/msg/Imu"](
            header=header(ns, "imu"), orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0), orientation_covariance=np.zeros(9),
            angular_velocity=vector(x=0.1 * i, y=-0.2, z=0.3), angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(x=0.0, y=9.81, z=0.01 * i), linear_acceleration_covariance=np.zeros(9))
        messages.append(("/imu", "sensor_msgs/msg/Imu", ns + 5, imu))
    return sorted(messages, key=lambda m: m[2])


ros1, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
(out / "small.bag").unlink(missing_ok=True)
writer = Writer1(out / "small.bag")
writer.set_compression(Writer1.CompressionFormat.BZ2)
with writer:
    connections = {}
    for topic, kind, ns, message in everything(ros1):
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=ros1)
        writer.write(connections[topic], ns, bytes(ros1.serialize_ros1(message, kind)))

all2 = [(topic, kind, ns, bytes(ros2.serialize_cdr(m, kind))) for topic, kind, ns, m in everything(ros2)]

(out / "small.db3").unlink(missing_ok=True)
database = sqlite3.connect(out / "small.db3")
database.execute("PRAGMA page_size = 512")
# The tables of rosbag2_storage_sqlite3.
database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,"
                 "serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL)")
database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL, "
                 "data BLOB NOT NULL)")
database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
ids = {}
for topic, kind, ns, data in all2:
    if topic not in ids:
        ids[topic] = len(ids) + 1
        database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (ids[topic], topic, kind))
    database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", (ids[topic], ns, data))
database.commit()
database.close()

with open(out / "small.mcap", "wb") as file:
    writer = McapWriter(file, compression=CompressionType.ZSTD, chunk_size=4096)
    writer.start(profile="ros2", library="make_bag_fixtures")
    channels = {}
    for topic, kind, ns, data in all2:
        if topic not in channels:
            schema = writer.register_schema(kind, "ros2msg", b"")
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic], ns, data, ns)
    writer.finish()
for path in sorted(out.iterdir()):
    print(path, path.stat().st_size, "bytes")
