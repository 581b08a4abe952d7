#!/usr/bin/env python3
"""Prints the tables of docs/figures/team.md: `cairn team graph` over the recorded graphs.

usage: tools/team_tables.py [CAIRN]   (the program; default target/release/cairn; recordings in CAIRN_DATA, else ../shared/data)
"""
import json
import os
import subprocess
import sys

CAIRN = sys.argv[1] if len(sys.argv) > 1 else "target/release/cairn"
DATA = os.environ.get("CAIRN_DATA", "../shared/data")


def run(*arguments):
    done = subprocess.run([CAIRN, "team", "graph", *arguments, "--json"], check=True, capture_output=True)
    return json.loads(done.stdout)


def row(name, a):
    reached = {r["within"]: r for r in a["reached"]}

    def cell(within):
        r = reached.get(within)
        return f"{r['exchanges']}: {r['sent_max'] / 1e3:.1f} / {r['received_max'] / 1e3:.0f}" if r else "-"

    last = a["exchanges"][-1]
    gap = "-" if a["certified_gap"] is None else f"{a['certified_gap']:.0e}"
    print(
        f"| {name} | {a['poses']} | {a['central_chi2']:.4f} | {cell(1e-3)} | {cell(1e-6)} | {last['sent_max'] / 1e3:.1f} | "
        f"{a['exchanges'][0]['cpu_ms_mean']:.0f} / {last['cpu_ms_mean']:.0f} | {a['central_ms']:.0f} | {gap} |"
    )


def head(what):
    print(f"| {what} | poses | central chi2 | exchanges to 0.1 %: kB sent / received | to 1e-6 | kB each further | ms a robot, first / last | ms central | certified |")
    print("|---|---|---|---|---|---|---|---|---|")


def main():
    head("team")
    for name in ["argos-2", "argos-4", "argos-10", "argos-10-spoiled"]:
        a = run(f"{DATA}/team/{name}")
        row(name, a)
        if a["rejected"]:
            print(f"<!-- {name}: rejected {len(a['rejected'])} of {a['loops']} -->")
    print()
    head("graph, robots")
    for name in ["smallGrid3D", "intel", "kitti_05", "parking-garage", "manhattan", "sphere2500"]:
        for robots in [2, 5, 10] + ([50] if name in ["parking-garage", "manhattan", "sphere2500"] else []):
            row(f"{name}, {robots}", run(f"{DATA}/graphs/{name}.g2o", "--robots", str(robots)))
    print()
    print("| argos-10, network | 0.1 % from | 1e-6 from | kB sent until then, at most |")
    print("|---|---|---|---|")
    for loss, late, twice in [(0, 0, 0), (0.3, 0, 0), (0.3, 0.3, 0.2), (0.6, 0.3, 0.2)]:
        network = ["--loss", str(loss), "--late", str(late), "--twice", str(twice), "--exchanges", "40"]
        reached = {r["within"]: r for r in run(f"{DATA}/team/argos-10", *network)["reached"]}
        near, at = reached.get(1e-3), reached.get(1e-6)
        sent = f"{near['sent_max'] / 1e3:.0f} / {at['sent_max'] / 1e3:.0f}" if near and at else "-"
        name = f"{loss:.0%} lost, {late:.0%} late by 1 to 3, {twice:.0%} twice"
        print(f"| {name} | {near and near['exchanges']} | {at and at['exchanges']} | {sent} |")


main()
