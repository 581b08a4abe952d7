"""Starts the Cairn node with the parameters of a camera, and RViz where it is asked for.

    ros2 launch cairn_ros cairn.launch.py params:=d435i_rgbd rviz:=true
    ros2 launch cairn_ros cairn.launch.py params:=/home/me/robot.yaml namespace:=robot map:=/data/home.map
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

ARGUMENTS = {
    "params": ("d435i_rgbd", "name of a file in params/, or the path of one of your own"),
    "namespace": ("", "namespace of the node"),
    "map": ("", "map file: read at the start where it exists, written by ~/save_map"),
    "base_frame": ("base_link", "frame of the robot"),
    "use_sim_time": ("false", "time is that of /clock"),
    "rviz": ("false", "opens RViz"),
}


def nodes(context):
    """The nodes, once the arguments are known."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    share = Path(get_package_share_directory("cairn_ros"))
    params = given["params"] if given["params"].endswith(".yaml") else str(share / "params" / f"{given['params']}.yaml")
    own = {"base_frame": given["base_frame"], "use_sim_time": given["use_sim_time"] == "true"}
    if given["map"]:
        own["map"] = given["map"]
    started = [
        Node(
            package="cairn_ros",
            executable="cairn-ros",
            name="cairn",
            namespace=given["namespace"],
            output="screen",
            respawn=True,
            parameters=[params, own],
        )
    ]
    if given["rviz"] == "true":
        view = ["-d", str(share / "rviz" / "cairn.rviz")]
        started.append(Node(package="rviz2", executable="rviz2", namespace=given["namespace"], arguments=view))
    return started


def generate_launch_description():
    """What `ros2 launch` starts."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=what)
        for name, (default, what) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])
