"""A node of rclpy that looks for the node named "cairn" and asks for one of its parameters; what it finds, as JSON."""

import json
import sys
import time

import rclpy
from rclpy.parameter_client import AsyncParameterClient

rclpy.init()
node = rclpy.create_node("far")
end = time.time() + float(sys.argv[1])
while time.time() < end and "cairn" not in node.get_node_names():
    rclpy.spin_once(node, timeout_sec=0.1)
found, frame = "cairn" in node.get_node_names(), None
client = AsyncParameterClient(node, "cairn")
if found and client.wait_for_services(5):
    future = client.get_parameters(["base_frame"])
    rclpy.spin_until_future_complete(node, future, timeout_sec=5)
    frame = future.result().values[0].string_value if future.done() else "no answer"
print(json.dumps({"found": found, "base_frame": frame}))
