"""What the node does beside tracking: services, another size, a clock that is set back, a name that is wrong."""

import threading
import time

import numpy as np
import pytest
from messages import header, make, stamp
from player import Player
from test_euroc import begin, outputs, seconds
from wire import Wire, until

class Caller:
    """Calls a service as rmw_cyclonedds does: a header with the caller's identity before the message."""

    def __init__(self, wire, name, package="std_srvs", kind="Trigger"):
        names = [f"{package}::srv::dds_::{kind}_{part}_" for part in ("Request", "Response")]
        self.request, response = (f"cyclone/msg/{kind}_{part}" for part in ("Request", "Response"))
        self.write = wire.writer(f"{name}Request", self.request, reliable=True, prefix="rq", dds_name=names[0])
        self.answers = wire.listen(f"{name}Reply", response, prefix="rr", dds_name=names[1])
        self.calls = 0

    def __call__(self):
        answer = self.ask()
        return answer.success, answer.message

    def ask(self, **fields):
        self.calls += 1
        assert until(lambda: self._try(fields), 10), "no answer"
        return next(a for _, a in self.answers if a.seq == self.calls)

    def _try(self, fields):
        self.write(make(self.request, guid=4711, seq=self.calls, **fields))
        return until(lambda: any(a.seq == self.calls and a.guid == 4711 for _, a in self.answers), 1.0)


def test_services(wire, node, euroc, tmp_path):
    """A map is saved and found again by a second node; a route is recorded."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    files = ["--map", tmp_path / "home.map", "--route", tmp_path / "home.route", "--rmw", "cyclonedds"]
    child = node(*player.arguments(), *files)
    names = ("save_map", "record", "stop_recording", "guide_home", "halt", "load_map", "reset")
    call = {name: Caller(wire, f"/cairn/{name}") for name in names}
    route = wire.listen("/route", "nav_msgs/msg/Path", latched=True)
    begin(player, child)
    assert call["halt"]()[0] is False
    player.play(10)
    assert call["record"]()[0]
    player.play(120, first=10)
    done, words = call["stop_recording"]()
    assert done and "points" in words, words
    done, words = call["save_map"]()
    assert done and (tmp_path / "home.map").stat().st_size > 10_000, words
    assert until(lambda: route and len(route[-1][1].poses) > 3, 5), "the route is published"
    said = wire.listen("/cairn/said", "std_msgs/msg/String")
    done, words = call["guide_home"]()
    print("guide_home:", done, words)
    assert words and until(lambda: said, 5), "the guide speaks"
    print("said:", [m.data for _, m in said])
    poses = len(out["/pose"])
    done, words = call["load_map"]()
    assert done, words
    player.play(160, first=100)
    assert until(lambda: len(out["/pose"]) > poses + 30, 5), "the place is found again in the saved map"
    assert child.end() == 0


def test_clock_is_set_back_and_pictures_of_another_size(wire, node, euroc):
    """A bag that begins again from its start: the map is kept, the stamps follow."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    child = node(*player.arguments(), "--use-sim-time")
    begin(player, child)
    player.play(60)
    time.sleep(0.5)
    before = len(out["/odom"])
    assert before > 50

    def earlier(name, k, message):
        message.header.stamp.sec -= 1000
        return [message]

    player.play(60, meddle=earlier)
    assert until(lambda: len(out["/odom"]) > before + 40, 5), "\n".join(child.lines)
    times = [seconds(m.header) for _, m in out["/odom"]]
    assert times[-1] < times[0] - 900
    jumps = [abs(b.pose.pose.position.x - a.pose.pose.position.x) for (_, a), (_, b) in zip(out["/odom"], out["/odom"][1:])]
    assert max(jumps) < 0.2, "odom never jumps"
    small = make("sensor_msgs/msg/Image", height=10, width=10, encoding="mono8", step=10, data=euroc.image("cam0", 0).data[:100])
    for k in range(50):
        small.header = header(time.time_ns() - 10**12 + k, "left_optical")
        player.images["cam0"](small)
        time.sleep(0.005)
    assert until(lambda: child.said("another size"), 5)
    assert sum("another size" in line for line in child.lines) == 1, "said once"
    assert sum("went backwards" in line for line in child.lines) == 1
    assert child.end() == 0


def test_time_is_that_of_the_clock(wire, node, euroc):
    """A bag that is played at half its speed: the time is that of /clock, and so is the age of pictures."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    clock = wire.writer("/clock", "rosgraph_msgs/msg/Clock", depth=1)
    ended = threading.Event()
    # At wall time t the clock is at 1000 s + half of what has passed.
    started = time.time()
    now = lambda: 1000 * 10**9 + int((time.time() - started) * 0.5e9)  # noqa: E731

    def tick():
        while not ended.is_set():
            clock(make("rosgraph_msgs/msg/Clock", clock=stamp(now())))
            time.sleep(0.01)

    def simulated(name, k, message):
        message.header.stamp = stamp(now())
        return [message]

    child = node(*player.arguments(), "--use-sim-time")
    begin(player, child)
    until(lambda: out["/diagnostics"], 5)
    without = {v.key for v in out["/diagnostics"][-1][1].status[0].values}
    assert not any("age of results" in key for key in without), "without /clock nothing is known of it"
    threading.Thread(target=tick, daemon=True).start()
    player.play(80, meddle=simulated)
    before = len(out["/diagnostics"])
    assert until(lambda: len(out["/diagnostics"]) > before, 5)
    ended.set()
    at, last = out["/diagnostics"][-1]
    told = seconds(last.header) - 1000
    assert abs(told - 0.5 * (at - started)) < 0.3, (told, 0.5 * (at - started))
    ages = [float(v.value) for _, m in out["/diagnostics"] for v in m.status[0].values if v.key == "age of results ms, median"]
    print("age of results, ms:", ages)
    # The node knows the time as of the last tick, which is up to 5 ms of the clock old (more on a busy machine).
    assert ages and -20 <= np.median(ages) < 500
    assert child.end() == 0


def test_goals_without_a_grid_are_refused(wire, node, euroc):
    player = Player(wire, euroc, imu=False)
    goal = wire.writer("/cairn/goal_pose", "geometry_msgs/msg/PoseStamped", reliable=True)
    child = node("--plan", *player.arguments())
    begin(player, child)

    def ask():
        goal(make("geometry_msgs/msg/PoseStamped", header=header(0, "map")))
        return until(lambda: child.said("a goal needs the occupancy grid"), 0.5)

    assert until(ask, 5), child.lines
    assert child.end() == 0


def test_it_starts_as_a_launch_file_starts_it(wire, node, euroc, tmp_path, monkeypatch):
    """Parameters from a file, names by remaps, a level, on this machine alone."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    player = Player(wire, euroc, imu=False)
    flags = player.arguments()
    named = dict(zip(flags[::2], flags[1::2]))
    file = tmp_path / "params.yaml"
    lines = [f"    {flag[2:].replace('-', '_')}: {topic}" for flag, topic in named.items()]
    others = ["    qos_overrides:", "      /tf:", "        publisher: {depth: 1}"]
    file.write_text("\n".join(["/robot/eye:", "  ros__parameters:", *lines, "/**:", "  ros__parameters:", *others]) + "\n")
    poses = wire.listen("/robot/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    child = node(
        "--ros-args", "-r", "__node:=eye", "-r", "__ns:=/robot", "--params-file", file,
        "-p", "base_from_camera:=[0.0, 0.0, 1.0, -0.5, 0.5, -0.5, 0.5]", "--log-level", "info", "--enclave", "/",
    )  # fmt: skip
    begin(player, child)
    player.play(40)
    assert until(lambda: len(poses) > 5, 20), child.lines
    assert child.said('no parameter "qos_overrides"') and child.said("DDS security"), child.lines
    assert child.end() == 0


def test_parameters_are_shown_and_files_can_be_set(wire, node):
    child = node("--camera", "stereo", "--rmw", "cyclonedds", "--ros-args", "-p", "grid_range_m:=4.5")
    kinds = {"get_parameters": "GetParameters", "set_parameters": "SetParameters"}
    get, set_ = (Caller(wire, f"/cairn/{name}", "rcl_interfaces", kind) for name, kind in kinds.items())
    values = get.ask(names=["grid_range_m", "camera", "use_sim_time", "map"]).values
    assert [v.type for v in values] == [3, 4, 1, 0]
    assert (values[0].double_value, values[1].string_value, values[2].bool_value) == (4.5, "stereo", False)
    value = make("rcl_interfaces/msg/ParameterValue", type=3, double_value=3.0)
    wanted = make("rcl_interfaces/msg/Parameter", name="grid_range_m", value=value)
    (result,) = set_.ask(parameters=[wanted]).results
    assert not result.successful and "only map and route can be set" in result.reason
    value = make("rcl_interfaces/msg/ParameterValue", type=4, string_value="home.map")
    (result,) = set_.ask(parameters=[make("rcl_interfaces/msg/Parameter", name="map", value=value)]).results
    assert result.successful and get.ask(names=["map"]).values[0].string_value == "home.map"
    assert get.ask(names=["grid_range_m"]).values[0].double_value == 4.5
    assert child.end() == 0


def test_waiting_is_said(wire, node):
    child = node("--camera", "stereo")
    assert until(lambda: child.said("waiting for /camera/left/image_raw (nobody publishes it)"), 20), child.lines
    assert child.end() == 0


@pytest.mark.parametrize("arguments", [(), ("--image", "/a b"), ("--camera", "mono", "--rig", "nowhere.toml")])
def test_wrong_usage_ends_with_a_reason(node, arguments):
    child = node(*arguments)
    assert child.child.wait(timeout=10) == 1
    assert until(lambda: child.said("error:"), 2), child.lines


def test_garbage_on_the_wire(wire, node, euroc):
    """A publisher that calls something else an image: it is said, and the next image is used."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    child = node(*player.arguments())
    begin(player, child)
    stranger = Wire()
    image = "sensor_msgs::msg::dds_::Image_"
    write = stranger.writer("/left/image_raw", "garbage/msg/Blob", dds_name=image)
    for words in ([], [0xFFFFFFFF] * 50, [3, 5, 0, 480, 640, 6] + [0] * 40, [0, 0, 1, 0, 0x7FFFFFFF, 0x7FFFFFFF, 1, 0, 0, 0xFFFF]):
        for _ in range(5):
            write(make("garbage/msg/Blob", data=np.array(words, dtype=np.uint32)))
            time.sleep(0.02)
    assert until(lambda: child.said("a message cannot be read"), 5), child.lines
    stranger.close()
    before = len(out["/odom"])
    player.play(60)
    assert until(lambda: len(out["/odom"]) > before + 40, 5), "\n".join(child.lines)
    assert not child.said("went backwards"), "what is no image says nothing of the time"
    assert child.end() == 0


def test_initial_pose(wire, node, euroc, tmp_path):
    """What a viewer says of the robot's place is a hint: it counts where an image shows it, and is refused in words elsewhere."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    child = node(*player.arguments(), "--map", tmp_path / "home.map", "--rmw", "cyclonedds")
    call = {name: Caller(wire, f"/cairn/{name}") for name in ("save_map", "load_map")}
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    write = wire.writer("/initialpose", kind, reliable=True)

    def say(x, y, frame="map", variance=0.25):
        """As RViz says it: on the plan, with half a metre of standard deviation."""
        sent = make(kind, header=header(0, frame))
        sent.pose.pose.position.x, sent.pose.pose.position.y, sent.pose.pose.orientation.w = float(x), float(y), 1.0
        sent.pose.covariance[0] = sent.pose.covariance[7] = variance
        write(sent)

    def warned(text):
        return out["/diagnostics"] and text in out["/diagnostics"][-1][1].status[0].message

    begin(player, child)
    player.play(130)
    places = {round(seconds(m.header), 3): m.pose.pose.position for _, m in out["/pose"]}
    here = {k: places[round(ns * 1e-9, 3)] for k, (ns, _) in player.sent.items() if round(ns * 1e-9, 3) in places}
    assert call["save_map"]()[0] and len(here) > 60
    assert call["load_map"]()[0]
    assert until(lambda: warned("not recognised in the saved map yet"), 5), "it does not say where it is before it knows"
    say(0, 0, "nowhere")
    assert until(lambda: child.said('refused: the frame "nowhere"'), 5) and until(lambda: warned("nowhere"), 5), child.lines
    say(0, 0, variance=-1.0)
    assert until(lambda: child.said("refused: its covariance is none"), 5), child.lines
    say(60, 0)
    assert until(lambda: child.said("looking for the place (60.0, 0.0)"), 5), child.lines
    player.play(105, first=100)
    assert until(lambda: child.said("the place (60.0, 0.0), within 1.5 m: refused: the map has nothing there"), 5), child.lines
    assert call["load_map"]()[0]
    near = here[max(here)]
    say(near.x + 0.4, near.y - 0.3)
    assert until(lambda: sum("looking for" in line for line in child.lines) == 2, 5), child.lines
    count = len(out["/pose"])
    player.play(130, first=100)
    # A busy machine may still have had a picture of the place in hand, and known it before it was said.
    assert until(lambda: child.said("1.5 m: recognised") or child.said("1.5 m: that is where the robot is"), 5), child.lines
    assert until(lambda: len(out["/pose"]) > count + 10, 5), "the place is known"
    # The map is where it was: what was said of a place before it was saved still holds.
    found = {round(seconds(m.header), 3): m.pose.pose.position for _, m in out["/pose"][count:]}
    off = [
        np.linalg.norm([found[t].x - here[k].x, found[t].y - here[k].y, found[t].z - here[k].z])
        for k, (ns, _) in player.sent.items()
        for t in [round(ns * 1e-9, 3)]
        if t in found and k in here
    ]
    print(f"{len(off)} poses after loading, {np.median(off):.3f} m from where they were before (median), {max(off):.3f} m at most")
    assert len(off) > 10 and max(off) < 0.1
    assert child.end() == 0


def check_features(pictures):
    """Somebody looks at the pictures with features: a few a second, gray but for the squares."""
    picture = pictures[-1]
    pixels = np.asarray(picture.data).reshape(picture.height, picture.width, 3)
    coloured = (pixels[..., 0] != pixels[..., 1]) | (pixels[..., 1] != pixels[..., 2])
    rate = len(pictures) / (seconds(pictures[-1].header) - seconds(pictures[0].header))
    print(f"{len(pictures)} pictures with features, {rate:.1f} a second, {coloured.mean():.3f} of the last one coloured")
    assert (picture.encoding, picture.header.frame_id, picture.step) == ("rgb8", "left_optical", 3 * picture.width)
    assert 2.0 < rate < 6.0 and 0.005 < coloured.mean() < 0.2


def test_planar(wire, node, euroc):
    """A robot on a plane: nothing that is published has height, roll or pitch. This one flies, which is noticed."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    child = node(*player.arguments(), "--planar")
    pictures = wire.listen("/cairn/features", "sensor_msgs/msg/Image")
    begin(player, child)
    player.play(300)
    assert until(lambda: len(out["/odom"]) > 150, 5), child.lines
    poses = [m.pose.pose for name in ("/odom", "/pose") for _, m in out[name]] + [p.pose for p in out["/path"][-1][1].poses]
    assert max(abs(v) for p in poses for v in (p.position.z, p.orientation.x, p.orientation.y)) < 1e-9
    moved = [np.hypot(p.position.x, p.position.y) for p in poses]
    transforms = [t.transform for _, m in out["/tf"] for t in m.transforms]
    assert max(abs(v) for t in transforms for v in (t.translation.z, t.rotation.x, t.rotation.y)) < 1e-9
    twists = [m.twist.twist for _, m in out["/odom"]]
    assert max(moved) > 0.1 and max(abs(v) for t in twists for v in (t.linear.z, t.angular.x, t.angular.y)) < 1e-9
    check_features([m for _, m in pictures])
    said = [line for line in child.lines if "the floor is not flat" in line]
    print(f"{max(moved):.2f} m from the start; {said}")
    assert said and any("the floor is not flat" in m.status[0].message for _, m in out["/diagnostics"])
    assert child.end() == 0


@pytest.mark.parametrize("with_wheels", [False, True])
def test_wheels_carry_the_pose_where_nothing_is_seen(wire, node, euroc, with_wheels):
    """Dark for a second and a half: with readings of the wheels the odometry goes on, without them it does not."""
    player, out = Player(wire, euroc, imu=False), outputs(wire)
    child = node(*player.arguments(), "--wheels", "/wheel_odom")
    kind, dark = "nav_msgs/msg/Odometry", range(180, 210)
    write = wire.writer("/wheel_odom", kind)
    truth = euroc.truth

    def meddle(name, k, message):
        if name == "cam0" and with_wheels:
            at = int(euroc.images["cam0"][k][0]) * 1e-9
            sent = make(kind, header=message.header, child_frame_id="base_link")
            p, q = sent.pose.pose.position, sent.pose.pose.orientation
            p.x, p.y, p.z, q.w, q.x, q.y, q.z = (float(np.interp(at, truth[:, 0], truth[:, i])) for i in range(1, 8))
            norm = np.sqrt(q.w**2 + q.x**2 + q.y**2 + q.z**2)
            q.w, q.x, q.y, q.z = q.w / norm, q.x / norm, q.y / norm, q.z / norm
            write(sent)
        if k in dark:
            message.data = np.full_like(message.data, 9)
        return [message]

    begin(player, child)
    player.play(240, meddle=meddle)
    time.sleep(1.0)
    times = [seconds(m.header) for _, m in out["/odom"]]
    there = [sum(abs(t - ns * 1e-9) < 1e-3 for t in times) for k, (ns, _) in player.sent.items() if k in dark]
    print(f"with wheels {with_wheels}: {sum(there)} poses in {len(dark)} dark pictures")
    assert sum(there) > 0.6 * len(dark) if with_wheels else sum(there) < 0.3 * len(dark), child.lines
    assert child.end() == 0
