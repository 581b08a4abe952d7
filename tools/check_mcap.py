#!/usr/bin/env python3
"""Reads an MCAP file of `cairn run --mcap` back with `mcap` and with `rosbags`, which share no code with this project.

    python3 -m venv /tmp/bags && /tmp/bags/bin/pip install rosbags mcap mcap-ros2-support numpy
    cairn run SOURCE --trajectory live.tum --live-trajectory live.tum --mcap out.mcap
    /tmp/bags/bin/python tools/check_mcap.py out.mcap live.tum

Every message is decoded by both with the definitions in the file; both must agree, the chunks' checksums and the index must
be right, and the poses must be those of the live trajectory.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

path, live = Path(sys.argv[1]), np.loadtxt(sys.argv[2])

with open(path, "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    summary = reader.get_summary()
    stated = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
    counts, poses, points, said = Counter(), [], 0, []
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        counts[channel.topic] += 1
        if channel.topic == "/pose":
            p, q, t = decoded.pose.position, decoded.pose.orientation, decoded.timestamp
            assert t.sec * 10**9 + t.nanosec == message.log_time
            poses.append([message.log_time * 1e-9, p.x, p.y, p.z, q.x, q.y, q.z, q.w])
        elif channel.topic == "/points":
            assert decoded.point_stride == 12 and [f.name for f in decoded.fields] == ["x", "y", "z"]
            cloud = np.frombuffer(bytes(decoded.data), dtype="<f4").reshape(-1, 3)
            assert np.isfinite(cloud).all()
            points = len(cloud)
        elif channel.topic == "/image":
            assert len(decoded.data) == decoded.step * decoded.height
        elif channel.topic in ("/said", "/events"):
            said.append(decoded.message)
        elif channel.topic == "/path":
            path_length = len(decoded.poses)
assert {t: n for t, n in stated.items() if n} == dict(counts), (stated, counts)
poses = np.array(poses)
assert poses.shape == live.shape, (poses.shape, live.shape)
difference = np.abs(poses[:, 1:] - live[:, 1:]).max()
assert difference < 1e-6, difference  # the text file has nine decimals or fewer
print(f"mcap: {sum(counts.values())} messages, {dict(counts)}")
print(f"mcap: poses differ from the live trajectory by {difference:.1e}, last cloud {points} points, path {path_length} poses")
print("mcap: events and words:", *said[:6], sep="\n  ")

with AnyReader([path]) as reader:
    again, largest = Counter(), 0.0
    live_poses = iter(poses)
    for connection, stamp, data in reader.messages():
        again[connection.topic] += 1
        message = reader.deserialize(data, connection.msgtype)
        if connection.topic == "/pose":
            p = message.pose.position
            largest = max(largest, np.abs(np.array([p.x, p.y, p.z]) - next(live_poses)[1:4]).max())
assert again == counts and largest == 0.0, (again, counts, largest)
print(f"rosbags: the same {sum(again.values())} messages")
