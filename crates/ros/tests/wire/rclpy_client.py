"""A node of rclpy, run by a Python that has it: what it hears, and what services answer, as JSON on the standard output."""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Trigger


def main(seconds):
    rclpy.init()
    node = rclpy.create_node("listener")
    heard = {"odom": [], "best_effort": 0}
    node.create_subscription(Odometry, "odom", lambda m: heard["odom"].append([m.child_frame_id, m.pose.pose.position.x]), 10)

    def count(_):
        heard["best_effort"] += 1

    node.create_subscription(PoseWithCovarianceStamped, "pose", count, qos_profile_sensor_data)
    say = node.create_publisher(PoseWithCovarianceStamped, "initialpose", 10)
    trigger, parameters = node.create_client(Trigger, "cairn/save_map"), AsyncParameterClient(node, "cairn")

    def answer(future):
        rclpy.spin_until_future_complete(node, future, timeout_sec=10)
        return future.result()

    end = time.time() + seconds
    while time.time() < end and len(heard["odom"]) < 30:
        rclpy.spin_once(node, timeout_sec=0.1)
    found = {"services": trigger.wait_for_service(5), "parameters": parameters.wait_for_services(5)}
    saved = answer(trigger.call_async(Trigger.Request()))
    values = answer(parameters.get_parameters(["base_frame", "map"]))
    set_to = answer(parameters.set_parameters([rclpy.Parameter("map", value=sys.argv[2])]))
    again = answer(trigger.call_async(Trigger.Request()))
    say.publish(PoseWithCovarianceStamped())
    rclpy.spin_once(node, timeout_sec=0.5)
    print(json.dumps({
        **heard, **found, "names": node.get_node_names(),
        "topics": dict(node.get_topic_names_and_types()).get("/odom"),
        "saved": [saved.success, saved.message], "again": [again.success, again.message],
        "base_frame": values.values[0].string_value, "map": values.values[1].string_value,
        "set": [[r.successful, r.reason] for r in set_to.results],
    }))  # fmt: skip


main(float(sys.argv[1]))
