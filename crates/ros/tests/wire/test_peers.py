"""Two machines without multicast between them: network namespaces that a cable of the kernel joins."""

import json
import os
import subprocess
import time
from pathlib import Path

import pytest
from wire import until

PYTHON = Path(os.environ.get("CAIRN_RCLPY", "").split(":")[0])
NAMES, ADDRESSES = ("cairn-a", "cairn-b"), ("10.99.7.1", "10.99.7.2")


def ip(*words):
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def machines():
    if not PYTHON.is_file():
        pytest.skip("skipped: rclpy is not installed")
    try:
        for name in NAMES:
            ip("netns", "add", name)
        ip("link", "add", "cable", "netns", NAMES[0], "type", "veth", "peer", "name", "cable", "netns", NAMES[1])
        for name, address in zip(NAMES, ADDRESSES):
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "addr", "add", f"{address}/24", "dev", "cable")
            ip("-n", name, "link", "set", "cable", "up", "multicast", "off")
    except (OSError, subprocess.CalledProcessError) as why:
        remove()
        pytest.skip(f"skipped: network namespaces cannot be made: {why}")
    # The participant's addresses are those that are up when it starts.
    carrier = lambda name: "LOWER_UP" in subprocess.run(["ip", "-n", name, "link", "show", "cable"], capture_output=True, text=True).stdout  # noqa: E731
    assert until(lambda: all(carrier(name) for name in NAMES), 10)
    time.sleep(0.5)
    yield
    remove()


def remove():
    for name in NAMES:
        subprocess.run(["ip", "netns", "del", name], capture_output=True)


def environment(**more):
    plain = {k: v for k, v in os.environ.items() if k != "ROS_AUTOMATIC_DISCOVERY_RANGE"}
    return {**plain, "ROS_DOMAIN_ID": "33", **more}


@pytest.mark.parametrize(("of_node", "of_other", "found"), [("", "", False), (ADDRESSES[1], "", True), ("", ADDRESSES[0], True)])
def test_static_peers(machines, of_node, of_other, found):
    """Either may name the other; where none does, they do not find each other."""
    there = lambda k, *words: ["ip", "netns", "exec", NAMES[k], *map(str, words)]  # noqa: E731
    words = there(0, os.environ["CAIRN_ROS"], "--image", "/a")
    node = subprocess.Popen(words, env=environment(ROS_STATIC_PEERS=of_node), stderr=subprocess.PIPE, text=True)
    try:
        script = Path(__file__).with_name("rclpy_far.py")
        words = there(1, PYTHON, script, 15 if found else 5)
        said = subprocess.run(words, env=environment(ROS_STATIC_PEERS=of_other), capture_output=True, text=True, timeout=60)
        assert said.returncode == 0, said.stderr
        heard = json.loads(said.stdout.splitlines()[-1])
        print(heard)
        assert heard == {"found": found, "base_frame": "base_link" if found else None}
    finally:
        node.terminate()
        assert node.wait(timeout=10) == 0
        node.stderr.close()
