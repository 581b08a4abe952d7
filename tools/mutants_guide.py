#!/usr/bin/env python3
"""Puts faults into the guide's safety logic, one at a time, and shows whether the simulated walks catch them.

    tools/mutants_guide.py [COMMAND]

COMMAND runs in a copy of the tracked files below target/mutants and exits 1 where a rule is broken more often than its limit. It is
the example `walks` on 60 routes (720 walks) unless given. Prints a table; exits 1 where a fault was not caught.
"""
import pathlib
import shutil
import subprocess
import sys

COMMAND = "cargo run --release --quiet -p cairn-trial --example walks -- --ways 60"
GUIDE = "crates/guide/src/"
# What is wrong, the file, the text there (once), and what stands there instead.
MUTANTS = [
    ("turns to the other side", "facing.rs", "wrap(heading - self.course)", "wrap(self.course - heading)"),
    ("left and right are exchanged", "direction.rs", "if angle_rad >= 0.0 { Side::Left }", "if angle_rad < 0.0 { Side::Left }"),
    ("a corner turns to the other side", "follow/at_maneuver.rs", "CueKind::TurnNow { turn_rad: turn,", "CueKind::TurnNow { turn_rad: -turn,"),
    ("corrections go to the other side", "follow/steer.rs", "let turn = -led.signum()", "let turn = led.signum()"),
    ("a step back goes to the other side", "follow/backwards.rs", "Step::BackAside(self.off_line(now))", "Step::BackAside(-self.off_line(now))"),
    ("the turn after a stop goes to the other side", "guide.rs", "First::Turn(follower.worded(turn))", "First::Turn(follower.worded(-turn))"),
    ("the side of the route is mirrored", "matcher.rs", "cross(&(d / d.norm()), &(p - foot))", "-cross(&(d / d.norm()), &(p - foot))"),
    ("backwards he is taken to go forwards", "facing.rs", "Facing::Backwards => (camera, wrap(camera + PI))", "Facing::Backwards => (camera, camera)"),
    ("a camera that faces back is taken to face ahead", "facing.rs", "Facing::Back => (wrap(camera + PI), wrap(camera + PI))", "Facing::Back => (camera, camera)"),
    ("the age of the pose is not checked", "stops.rs", "} else if input.now - input.pose_stamp > config.stale_s {", "} else if false {"),
    ("poses of 1.5 s guide", "stops.rs", "input.now - input.pose_stamp > config.stale_s", "input.now - input.pose_stamp > 1.5"),
    ("lost tracking does not stop", "stops.rs", "} else if input.confidence == Confidence::Lost {", "} else if false {"),
    ("arrived 2.5 m from the end", "follow/arrival.rs", "const ARRIVED_M: f64 = 1.0;", "const ARRIVED_M: f64 = 2.5;"),
    ("arrived is never said", "follow/arrival.rs", "(level && will_stand_there", "(level && false && will_stand_there"),
    ("a corner far ahead is due", "follow/at_maneuver.rs", "middle - now.at.along_m > early && ", "middle - now.at.along_m > early + 6.0 && "),
    ("a correction forgets the turn at a sharp corner", "matcher.rs", "self.passed_m = (self.passed_m + metres).clamp(0.0, length_m);", "self.passed_m = 0.0;"),
    ("corrections of the map are dropped", "correction.rs", "follower.replace_plan(plan);", "let _ = plan;"),
    ("no sign while stopped", "guide.rs", "const QUIET_S: f64 = 3.0;", "const QUIET_S: f64 = 30.0;"),
    ("stop is not said again, and no sign", "guide.rs", "(waits && now - since >= QUIET_S)", "(false && waits && now - since >= QUIET_S)"),
    ("corrections follow each other after a second", "follow/steer.rs", "now.stamp) >= s.adjust_again_s", "now.stamp) >= 1.0"),
    ("corrections between the bends of a corner", "follow/steer.rs", "if self.corner_here(now).is_some() { None }", "if false { None }"),
]


def main():
    command = sys.argv[1] if len(sys.argv) > 1 else COMMAND
    root = pathlib.Path(__file__).resolve().parent.parent
    copy = root / "target" / "mutants"
    for name in subprocess.check_output(["git", "ls-files"], cwd=root, text=True).splitlines():
        source, target = root / name, copy / name
        if source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
    survived = 0
    print("| fault | caught |\n|---|---|", flush=True)
    for what, name, old, new in MUTANTS:
        path = copy / GUIDE / name
        text = path.read_text()
        if text.count(old) != 1:
            sys.exit(f"{name} has {text.count(old)} times: {old}")
        path.write_text(text.replace(old, new))
        try:
            ended = subprocess.run(command, shell=True, cwd=copy, capture_output=True, text=True)
        finally:
            path.write_text(text)
        if ended.returncode not in (0, 1):
            sys.exit(f"{what}: {command} ended with {ended.returncode}\n{ended.stderr}")
        rules = sorted({line.split("BROKEN ")[1].split(":")[0] for line in ended.stdout.splitlines() if "BROKEN " in line})
        survived += not rules
        print(f"| {what} | {', '.join(rules) or '**no**'} |", flush=True)
    sys.exit(survived > 0)


main()
