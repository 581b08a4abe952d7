"""ROS itself on the other side: rclpy over Fast DDS hears the node, calls its services and sets its parameters."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from player import Player
from test_euroc import begin
from wire import DOMAIN, until

PYTHONS = [Path(path) for path in os.environ.get("CAIRN_RCLPY", "").split(":") if path]


@pytest.mark.skipif(not PYTHONS, reason="skipped: rclpy is not installed")
@pytest.mark.parametrize("python", PYTHONS, ids=[path.parents[1].name for path in PYTHONS])
def test_rclpy(wire, node, euroc, tmp_path, python):
    player = Player(wire, euroc, imu=False)
    home, other = tmp_path / "home.map", tmp_path / "other.map"
    child = node(*player.arguments(), "--map", home, "--rmw", "fastrtps")
    begin(player, child)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    script = Path(__file__).with_name("rclpy_client.py")
    client = subprocess.Popen(
        [python, script, "25", str(other)], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    for _ in range(2):
        player.play(150)
    said, faults = client.communicate(timeout=60)
    assert client.returncode == 0, faults
    heard = json.loads(said.splitlines()[-1])
    print({**heard, "odom": len(heard["odom"])})
    assert len(heard["odom"]) >= 30 and heard["odom"][0][0] == "base_link" and heard["best_effort"] > 5
    assert heard["topics"] == ["nav_msgs/msg/Odometry"] and "cairn" in heard["names"]
    assert heard["saved"][0] and home.stat().st_size > 10_000, heard["saved"]
    assert (heard["base_frame"], heard["map"]) == ("base_link", str(home))
    # A parameter that is set counts from the next call on.
    assert heard["set"] == [[True, ""]] and heard["again"][0] and other.stat().st_size > 10_000, heard
    assert until(lambda: child.said("initialpose: refused"), 5), child.lines
    assert child.end() == 0
