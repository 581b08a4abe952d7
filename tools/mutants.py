#!/usr/bin/env python3
"""Puts faults into the safety logic, one at a time, and shows on which simulated walk a rule is first broken.

    tools/mutants.py [--seeds FROM..TO] [--write] [NUMBER ...]

All faults go into one copy of the tracked files below target/mutants, each behind a switch, and `cairn-sim` is built there once. It is run with
each of them (or those with these numbers, from 0), and without any, where no rule may be broken on the same seeds. Prints a table, which
--write puts into docs/figures/mutants.md; exits 1 where a fault was not caught.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys

GUIDE, SESSION = "crates/guide/src/", "crates/session/src/"
# What is wrong, the file, the text before the place, the expression there, and what stands there instead.
MUTANTS = [
    ("turns to the other side", GUIDE + "facing.rs", "", "wrap(heading - self.course)", "wrap(self.course - heading)"),
    ("left and right are exchanged", GUIDE + "direction.rs", "if ", "angle_rad >= 0.0", "angle_rad < 0.0"),
    ("a corner turns to the other side", GUIDE + "follow/at_maneuver.rs", "CueKind::TurnNow { turn_rad: ", "turn", "-turn"),
    ("corrections go to the other side", GUIDE + "follow/steer.rs", "Some(CueKind::Adjust(", "turn", "-turn"),
    ("a step back goes to the other side", GUIDE + "follow/backwards.rs", "Step::BackAside(", "self.off_line(now)", "-self.off_line(now)"),
    ("the turn after a stop goes to the other side", GUIDE + "guide.rs", "First::Turn(", "follower.worded(turn)", "follower.worded(-turn)"),
    ("who walks backwards is taken to walk forwards", GUIDE + "facing.rs", "Facing::Backwards => ", "(camera, wrap(camera + PI))", "(camera, camera)"),
    ("a camera that faces back is taken to face ahead", GUIDE + "facing.rs", "Facing::Back => ", "(wrap(camera + PI), wrap(camera + PI))", "(camera, camera)"),
    ("directions while guidance is paused", SESSION + "session/guide.rs", "if ", "self.guiding.is_some() && !self.is_guiding()", "false"),
    ("poses without the map guide for ever", GUIDE + "stops.rs", "} else if ", "blind_s > config.blind_s", "false"),
    ("poses that run away guide", GUIDE + "stops.rs", "|| ", "runs_away", "false"),
    ("guidance goes on at the first good pose", GUIDE + "stops.rs", "if ", "now - since < config.resume_s", "false"),
    ("one pose elsewhere is believed", GUIDE + "jumps.rs", "", "self.elsewhere.is_some()", "false"),
    ("whoever is elsewhere is looked for here", GUIDE + "matcher.rs", "self.anywhere = ", "true", "false"),
    ("arrived is said 3 m from the end", GUIDE + "follow/arrival.rs", "", "ARRIVED_M", "3.0"),
    ("no sign while stopped", GUIDE + "guide.rs", "", "now - since >= QUIET_S", "false"),
    ("corrections of the map are dropped", GUIDE + "correction.rs", "        ", "follower.replace_plan(plan)", "drop(plan)"),
    ("the voice speaks over itself", GUIDE + "announcer.rs", "other => ", "other.is_some()", "false"),
    ("the way of the words is not counted", SESSION + "age.rs", "age_s + ", "bound_s.max(delivery_s)", "0.0"),
    ("a picture of unknown age is fresh", SESSION + "age.rs", "Age::Unknown => ", "true", "false"),
    ("pictures of 0.9 s guide", SESSION + "age.rs", "oldest_s.is_nan() || ", "oldest_s > STALE_S", "oldest_s > 0.9"),
    ("a direction that waited is said however old", SESSION + "speech.rs", "if ", "!ages.of(Some(direction.pose)).is_stale()", "true"),
    ("metres without a unit", SESSION + "speech.rs", "metric: ", "self.phrases.metric && metric", "self.phrases.metric"),
    ("what the disk refused is forgotten", SESSION + "disk.rs", "        ", "self.waiting.extend_from_slice(data)", "drop(self.trouble.now().is_none().then(|| self.waiting.extend_from_slice(data)))"),
]
SWITCH = """
pub(crate) fn is_mutant(number: usize) -> bool {
    static CHOSEN: std::sync::OnceLock<Option<usize>> = std::sync::OnceLock::new();
    let chosen = CHOSEN.get_or_init(|| std::env::var("CAIRN_MUTANT").ok()?.parse().ok());
    *chosen == Some(number)
}
"""


def mutated(root):
    """The files with all faults, by name."""
    texts = {}
    for number, (what, name, before, old, new) in enumerate(MUTANTS):
        text = texts.get(name) or (root / name).read_text()
        places = list(re.finditer(re.escape(before + old) + r"(?!\w)", text))
        if before == "" and old.isupper():
            # A constant: where it is used.
            places = [place for place in places if not text[: place.start()].endswith("const ")]
        if len(places) != 1:
            sys.exit(f"{what}: {name} has {len(places)} times: {before}{old}")
        at = places[0]
        switched = f"{before}(if crate::is_mutant({number}) {{ {new} }} else {{ {old} }})"
        texts[name] = text[: at.start()] + switched + text[at.end() :]
    for folder in (GUIDE, SESSION):
        texts[folder + "lib.rs"] = (root / folder / "lib.rs").read_text() + SWITCH
    return texts


def copied(root, copy):
    texts = mutated(root)
    for name in subprocess.check_output(["git", "ls-files"], cwd=root, text=True).splitlines():
        if not (root / name).is_file():
            continue
        content, target = texts[name].encode() if name in texts else (root / name).read_bytes(), copy / name
        if not (target.is_file() and target.read_bytes() == content):
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
            shutil.copymode(root / name, target)


def walked(copy, number, seeds):
    """The output of the walks with a fault until the first on which a rule is broken."""
    environment = {**os.environ, "CAIRN_MUTANT": str(number)}
    command = [copy / "target" / "release" / "cairn-sim", "--seeds", seeds, "--first"]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True)
    if ended.returncode not in (0, 1) or "walks," not in ended.stdout:
        sys.exit(f"cairn-sim ended with {ended.returncode}\n{ended.stdout}\n{ended.stderr}")
    return re.search(r"BROKEN (\w+) on .*\n\s+(\d+) at", ended.stdout)


def main():
    words = sys.argv[1:]
    seeds = words[words.index("--seeds") + 1] if "--seeds" in words else "0..10000"
    chosen = [int(word) for word in words if word.isdigit()] or range(len(MUTANTS))
    root = pathlib.Path(__file__).resolve().parent.parent
    copy = root / "target" / "mutants"
    copied(root, copy)
    environment = {**os.environ, "CARGO_TARGET_DIR": str(copy / "target")}
    subprocess.run(["cargo", "build", "--release", "--quiet", "-p", "cairn-faults"], cwd=copy, env=environment, check=True)
    table, survived, last = "| fault | file | rule that was broken | on walk |\n|---|---|---|---|\n", 0, 0
    print(table, end="", flush=True)
    for number in chosen:
        what, name = MUTANTS[number][:2]
        found = walked(copy, number, seeds)
        survived += found is None
        rule, seed = found.groups() if found else ("**none**", "")
        last = max(last, int(seed or 0))
        line = f"| {what} | `{name.removeprefix('crates/').replace('/src', '')}` | {rule} | {seed} |\n"
        table += line
        print(line, end="", flush=True)
    unfounded = walked(copy, "none", f"{seeds.split('..')[0]}..{last + 1}")
    if unfounded:
        sys.exit("without any fault {} is broken on walk {}".format(*unfounded.groups()))
    if "--write" in words:
        page = root / "docs" / "figures" / "mutants.md"
        before = page.read_text().split("<!-- figures -->")[0]
        page.write_text(f"{before}<!-- figures -->\n\n{table}")
    sys.exit(survived > 0)


main()
