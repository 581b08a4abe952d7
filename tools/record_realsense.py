#!/usr/bin/env python3
"""Records a software device with the RealSense SDK: OUT.bag (pyrealsense2 up to 2.57) or OUT.db3 (since 2.58).

    python3 -m venv /tmp/rs && /tmp/rs/bin/pip install pyrealsense2==2.59.1.11053 numpy pillow   # and apt's libusb-1.0-0
    /tmp/rs/bin/python tools/record_realsense.py crates/sources/tests/data/realsense-2.59.db3
    /tmp/rs/bin/python tools/record_realsense.py kitchen.db3 --folder .../7scenes-kitchen      # frames of 7-Scenes at 30 Hz

Without a folder it is the fixture of crates/sources/tests: three images of 16x12 pixels at 20 Hz from t = 100 s of the device's
clock, depth 3 ms later, both of one value (colour (40, 90 + i, 200), depth 15000 units); a gyroscope at 100 Hz (0, 0, i) and an
accelerometer at 31.25 Hz (0, -9.81, t - 100 s) from before until after. A unit of depth is 0.0001 m. The colour camera has inverse
Brown-Conrady, is turned by 37 degrees about z and moved against depth. The host's clock is another, and frames arrive unevenly.
"""

import argparse
import gc
import re
import struct
import time
from pathlib import Path

import numpy as np
import pyrealsense2 as rs

UNIT_M = 0.0001
CLOCK = rs.timestamp_domain.hardware_clock
keep = []  # The SDK keeps pointers to what it is given.


def extrinsics(translation, rotation=(1, 0, 0, 0, 1, 0, 0, 0, 1)):
    out = rs.extrinsics()
    out.rotation, out.translation = [float(v) for v in rotation], [float(v) for v in translation]
    return out


def video(sensor, kind, uid, fmt, bpp, camera, model=rs.distortion.brown_conrady, coeffs=(0, 0, 0, 0, 0)):
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fps, stream.bpp, stream.fmt = kind, 0, uid, 30, bpp, fmt
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = camera
    lens.model, lens.coeffs = model, [float(c) for c in coeffs]
    stream.width, stream.height, stream.intrinsics = lens.width, lens.height, lens
    return sensor.add_video_stream(stream)


def motion(sensor, kind, uid, fps):
    stream = rs.motion_stream()
    stream.type, stream.index, stream.uid, stream.fps, stream.fmt = kind, 0, uid, fps, rs.format.motion_xyz32f
    stream.intrinsics = rs.motion_device_intrinsic()
    return sensor.add_motion_stream(stream)


class Device:
    """A software device with depth, colour, gyroscope and accelerometer, and its recorder."""

    def __init__(self, path, camera, lens, depth_to_colour):
        self.device = rs.software_device()
        names = ("Stereo Module", "RGB Camera", "Motion Module", "Place")
        self.sensors = dict(zip(names, [self.device.add_sensor(name) for name in names]))
        stereo, rgb, imu, place = self.sensors.values()
        self.depth = video(stereo, rs.stream.depth, 0, rs.format.z16, 2, camera)
        self.colour = video(rgb, rs.stream.color, 1, rs.format.rgb8, 3, camera, *lens)
        self.gyro, self.accel = motion(imu, rs.stream.gyro, 2, 200), motion(imu, rs.stream.accel, 3, 63)
        stereo.add_read_only_option(rs.option.depth_units, UNIT_M)
        # A software device records where a stream is once a *video* frame of its number has come. So the two of the IMU get one.
        self.places = [video(place, rs.stream.fisheye, uid, rs.format.y8, 1, camera) for uid in (2, 3)]
        self.depth.register_extrinsics_to(self.colour, depth_to_colour)
        for stream in (self.gyro, self.accel, *self.places):
            self.depth.register_extrinsics_to(stream, extrinsics((0.005, -0.01, 0.0)))
        self.recorder = rs.recorder(str(path), self.device)
        self.recorded = [s for s in self.recorder.query_sensors() if s.get_info(rs.camera_info.name) != "Place"]
        for sensor in self.recorded:
            sensor.open(sensor.get_stream_profiles())
            sensor.start(lambda frame: None)
        place.open(self.places)
        place.start(lambda frame: None)
        for stream in self.places:
            self.image("Place", stream, np.zeros((camera[1], camera[0]), np.uint8), 1.0, 1)

    def image(self, sensor, stream, pixels, ms, number):
        frame = rs.software_video_frame()
        frame.pixels, frame.bpp = pixels, pixels.dtype.itemsize * (pixels.shape[2] if pixels.ndim == 3 else 1)
        frame.stride = frame.bpp * pixels.shape[1]
        frame.timestamp, frame.domain, frame.frame_number = ms, CLOCK, number
        frame.profile = stream.as_video_stream_profile()
        if stream is self.depth:
            frame.depth_units = UNIT_M
        keep.append((frame, pixels))
        self.sensors[sensor].on_video_frame(frame)

    def sample(self, stream, xyz, ms, number):
        vector = rs.vector()
        vector.x, vector.y, vector.z = xyz
        frame = rs.software_motion_frame()
        frame.data, frame.timestamp, frame.domain, frame.frame_number = vector, ms, CLOCK, number
        frame.profile = stream.as_motion_stream_profile()
        keep.append((frame, vector))
        self.sensors["Motion Module"].on_motion_frame(frame)

    def close(self):
        time.sleep(0.3)
        for sensor in (*self.recorded, self.sensors["Place"]):
            sensor.stop()
            sensor.close()
        # The file is complete when nothing holds the recorder.
        self.recorder = self.recorded = None
        keep.clear()
        gc.collect()


def fixture(path):
    lens = (rs.distortion.inverse_brown_conrady, (0.12, -0.25, 0.0005, -0.0007, 0.08))
    turned = extrinsics((0.015, 0.002, -0.003), (0.8, 0.6, 0, -0.6, 0.8, 0, 0, 0, 1))  # column by column
    device = Device(path, (16, 12, 15.0, 15.5, 7.5, 5.5), lens, turned)
    events = []
    for i in range(3):
        colour = np.tile(np.array([40, 90 + i, 200], np.uint8), (12, 16, 1))
        depth = np.full((12, 16), 15000, np.uint16)
        events.append((100e3 + 50 * i, device.image, ("RGB Camera", device.colour, colour)))
        events.append((100e3 + 50 * i + 3, device.image, ("Stereo Module", device.depth, depth)))
    for i in range(14):
        events.append((99985.0 + 10 * i, device.sample, (device.gyro, (0.0, 0.0, float(i)))))
    for i in range(6):
        ms = 99970.0 + 32 * i
        events.append((ms, device.sample, (device.accel, (0.0, -9.81, (ms - 100e3) * 1e-3))))
    for number, (ms, send, what) in enumerate(sorted(events, key=lambda e: e[0])):
        send(*what, ms, number)
        time.sleep(0.002 * (1 + number % 3))
    device.close()
    if path.suffix == ".bag":
        # The index at the end repeats the definition of each message for each topic, 50 kB; nothing here reads it.
        whole = path.read_bytes()
        at = whole.index(b"index_pos=") + len(b"index_pos=")
        path.write_bytes(whole[: struct.unpack("<Q", whole[at : at + 8])[0]])


def seven_scenes(path, folder, frames):
    from PIL import Image

    device = Device(path, (640, 480, 585.0, 585.0, 320.0, 240.0), (), extrinsics((0, 0, 0)))
    names = sorted(p for p in folder.iterdir() if re.search(r"\.color\.(jpg|png)$", p.name))
    sent = 0
    for i, name in enumerate(names[:frames]):
        colour = np.array(Image.open(name).convert("RGB"))
        mm = np.array(Image.open(str(name).split(".color.")[0] + ".depth.png")).astype(np.uint32)
        units = np.where((mm == 65535) | (mm * 10 > 65535), 0, mm * 10).astype(np.uint16)
        ms = i * 1000 / 30
        device.image("RGB Camera", device.colour, colour, 100e3 + ms, i)
        device.image("Stereo Module", device.depth, units, 100e3 + ms + 2, i)
        # Nobody knows what an IMU would have read: it stands still.
        while sent * 5 < ms + 40:
            device.sample(device.gyro, (0.0, 0.0, 0.0), 99990.0 + 5 * sent, sent)
            device.sample(device.accel, (0.0, -9.81, 0.0), 99990.0 + 5 * sent, sent)
            sent += 1
        time.sleep(0.05)
    device.close()


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("out", type=Path)
parser.add_argument("--folder", type=Path, help="frames of a folder of 7-Scenes instead of the fixture")
parser.add_argument("--frames", type=int, default=100)
given = parser.parse_args()
if given.folder:
    seven_scenes(given.out, given.folder, given.frames)
else:
    fixture(given.out)
