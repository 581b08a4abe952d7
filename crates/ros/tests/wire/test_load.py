"""Stereo of 640x480 at 30 Hz for a while: no growing delay, no growing memory."""

import os
import time

import numpy as np
from messages import header, make
from player import Player
from test_euroc import begin, outputs, seconds
from wire import until

SECONDS = float(os.environ.get("CAIRN_ROS_LOAD_S", "20"))
RATE_HZ = 30


class Small(Player):
    """The recording cut to 640x480 in the middle."""

    def picture(self, name, k):
        image = super().picture(name, k)
        pixels = np.ascontiguousarray(image.data.reshape(480, 752)[:, 56:696])
        return make(
            "sensor_msgs/msg/Image", header=image.header, height=480, width=640, encoding="mono8", step=640,
            data=pixels.ravel(),
        )  # fmt: skip

    def info(self, name, ns):
        info = self.euroc.camera_info(name, ns)
        info.width = 640
        info.k[2] -= 56
        info.p[2] -= 56
        return info

    def hello(self, ns):
        for name, write in self.infos.items():
            write(self.info(name, ns))


def test_no_growth_at_30_hz(wire, node, euroc):
    player, out = Small(wire, euroc, imu=False), outputs(wire)
    child = node(*player.arguments())
    begin(player, child)
    pictures = [[player.picture(name, k) for name in ("cam0", "cam1")] for k in range(280)]
    # There and back, so that motion stays continuous for as long as the test takes.
    order = list(range(280)) + list(range(278, 0, -1))
    frames, started, cpu = int(SECONDS * RATE_HZ), time.time() + 0.1, child.cpu_s()
    sent, memory = {}, []
    for n in range(frames):
        due = started + n / RATE_HZ
        time.sleep(max(0.0, due - time.time()))
        ns = int(due * 1e9)
        for name, image in zip(("cam0", "cam1"), pictures[order[n % len(order)]]):
            player.move(image, ns)
            player.images[name](image)
        sent[ns] = time.time()
        if n % RATE_HZ == 0:
            memory.append(child.memory_mb())
    took = time.time() - started
    until(lambda: seconds(out["/odom"][-1][1].header) * 1e9 >= max(sent) - 2e6, 2)
    keys = np.array(sorted(sent))
    latency = np.array([
        at - sent[keys[np.abs(keys - seconds(m.header) * 1e9).argmin()]] for at, m in out["/odom"]
        if seconds(m.header) * 1e9 >= keys[0] - 1e6
    ]) * 1e3  # fmt: skip
    third = len(latency) // 3
    first, last = np.median(latency[third // 2 : third]), np.median(latency[-third:])
    print(
        f"{frames} pairs in {took:.1f} s, {len(latency)} poses ({len(latency) / frames:.2f}), latency median "
        f"{np.median(latency):.1f} ms p99 {np.percentile(latency, 99):.1f} ms (early {first:.1f}, late {last:.1f}), CPU "
        f"{(child.cpu_s() - cpu) / took * 100:.0f} % of one core, memory {memory[len(memory) // 3]:.0f} to {memory[-1]:.0f} "
        f"MB, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )
    assert took < SECONDS * 1.1
    # A machine that does other work leaves out pictures, but what it takes is new: no picture waits for longer than 150 ms.
    busy = os.getloadavg()[0] > os.cpu_count()
    assert len(latency) > (0.4 if busy else 0.9) * frames
    assert last < first + (60 if busy else 15) and last < 150, "the delay grows"
    assert child.end() == 0
