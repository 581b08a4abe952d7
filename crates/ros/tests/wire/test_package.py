"""The ament package: built and installed by ament_cmake itself, found by the index, and started as its launch file says."""

import os
import subprocess
import sys
import types
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from wire import until

PACKAGE = Path(__file__).parents[4] / "packaging/ros2/cairn_ros"


@pytest.fixture(scope="module")
def share(tmp_path_factory):
    """Where the package is installed."""
    folder, venv = tmp_path_factory.mktemp("package"), Path(sys.prefix)
    build, to = folder / "build", folder / "install"
    options = {
        "CMAKE_PREFIX_PATH": venv,
        "CMAKE_INSTALL_PREFIX": to,
        "Python3_EXECUTABLE": sys.executable,
        "CAIRN_ROS": os.environ["CAIRN_ROS"],
    }
    environment = {**os.environ, "PATH": f"{venv}/bin:{os.environ['PATH']}"}
    for command in (
        ["cmake", "-S", PACKAGE, "-B", build, "-G", "Ninja", *(f"-D{k}={v}" for k, v in options.items())],
        ["cmake", "--build", build],
        ["cmake", "--install", build],
    ):
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    before = os.environ.get("AMENT_PREFIX_PATH")
    os.environ["AMENT_PREFIX_PATH"] = str(to)
    yield Path(get_package_share_directory("cairn_ros"))
    os.environ.pop("AMENT_PREFIX_PATH") if before is None else os.environ.update(AMENT_PREFIX_PATH=before)


def launched(share, monkeypatch, **given):
    """The nodes of the launch file; `launch` and `launch_ros` are not on PyPI, so stand-ins write down what it says."""

    def said(*positional, **named):
        return types.SimpleNamespace(positional=positional, **named)

    modules = {
        "launch": said(LaunchDescription=lambda entities: entities),
        "launch.actions": said(DeclareLaunchArgument=said, OpaqueFunction=said),
        "launch_ros": said(),
        "launch_ros.actions": said(Node=said),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    scope = {}
    exec(compile((share / "launch/cairn.launch.py").read_text(), "cairn.launch.py", "exec"), scope)
    *arguments, function = scope["generate_launch_description"]()
    known = {a.positional[0]: a.default_value for a in arguments}
    assert set(given) <= set(known)
    return function.function(types.SimpleNamespace(launch_configurations={**known, **given}))


def command_line(node):
    """What launch_ros makes of a node's name, namespace and parameters."""
    line = ["--ros-args", "-r", f"__node:={node.name}"]
    if node.namespace:
        line += ["-r", f"__ns:=/{node.namespace}"]
    for parameters in node.parameters:
        if isinstance(parameters, dict):
            for name, value in parameters.items():
                line += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
        else:
            line += ["--params-file", parameters]
    return line


def test_the_installed_program_is_the_node(share):
    program = share.parents[1] / "lib/cairn_ros/cairn-ros"
    assert os.access(program, os.X_OK)
    said = subprocess.run([program, "--version"], capture_output=True, text=True)
    version = (share / "package.xml").read_text().split("<version>")[1].split("<")[0]
    assert said.stdout.strip() == f"cairn-ros {version}", said


@pytest.mark.parametrize(
    ("params", "topic"),
    [
        ("d435i_rgbd", "/camera/camera/aligned_depth_to_color/image_raw"),
        ("d435i_stereo", "/camera/camera/imu"),
        ("stereo", "/camera/right/image_raw"),
        ("phone", "/phone/imu"),
    ],
)
def test_each_file_of_parameters_starts_the_node(share, node, monkeypatch, tmp_path, params, topic):
    home = tmp_path / "home.map"
    (cairn,) = launched(share, monkeypatch, params=params, namespace="robot", map=str(home))
    assert (cairn.package, cairn.executable) == ("cairn_ros", "cairn-ros")
    child = node(*command_line(cairn))
    assert until(lambda: child.said(f"{topic} (nobody publishes it)"), 20), child.lines
    assert not child.said("no parameter"), child.lines
    assert child.end() == 0


def test_rviz_opens_with_the_topics_of_the_node(share, monkeypatch):
    _, rviz = launched(share, monkeypatch, rviz="true")
    view = Path(rviz.arguments[1]).read_text()
    published = (PACKAGE.parents[2] / "docs/formats/ros.md").read_text()
    shown = [line.split("Value: ")[1] for line in view.splitlines() if "Value: " in line]
    assert len(shown) == 5
    assert all(f"`{topic}`" in published or f"`~/{topic}`" in published for topic in shown), shown
