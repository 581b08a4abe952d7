"""Whole builds over Ray: the same atlas in order, over two workers, with one of them killed, and in S3."""

import subprocess
import time
from pathlib import Path
from typing import Any

import cairn.fleet
import pytest
from conftest import arguments, build, children, kill_a_worker


def upload(client: Any, folder: Path, prefix: str) -> None:
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            client.put_object(Bucket="walks", Key=f"{prefix}/{file.relative_to(folder)}", Body=file.read_bytes())


@pytest.fixture(scope="module")
def in_order(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return build(recordings, tmp_path_factory.mktemp("in-order"), "--in-order")


def test_walks_of_one_house_become_one_atlas(in_order: dict[str, Any]) -> None:
    assert in_order["maps"] == 9 and not in_order["unmapped"]
    houses = [{name.split("-")[0] for part in atlas for name in part} for atlas in in_order["atlases"]]
    assert sorted(map(sorted, houses)) == [["house11"], ["house12"], ["house13"]], in_order["atlases"]


@pytest.mark.parametrize("deaths", [0, 2])
def test_two_workers_make_the_same_atlas_though_some_are_killed(
    recordings: Path, in_order: dict[str, Any], tmp_path: Path, deaths: int
) -> None:
    driver = subprocess.Popen(
        arguments(recordings, tmp_path / "store", "--workers", "2"), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    killed = [kill_a_worker(driver.pid) for _ in range(deaths)]
    out, said = driver.communicate(timeout=600)
    assert driver.returncode == 0, (killed, said)
    atlas = (tmp_path / "store" / "atlas.json").read_bytes()
    assert in_order["digest"] in out.decode() and atlas, (killed, said)
    again = build(recordings, tmp_path / "store", "--in-order")
    assert again["digest"] == in_order["digest"]
    assert [(cost["tasks"], cost["reused"]) for cost in again["costs"]] == [(cost["tasks"],) * 2 for cost in again["costs"]]


def test_a_build_that_is_killed_leaves_no_process_and_goes_on_where_it_was(
    recordings: Path, in_order: dict[str, Any], tmp_path: Path
) -> None:
    program = subprocess.Popen(
        arguments(recordings, tmp_path / "store", "--workers", "2"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    kill_a_worker(program.pid)
    below = children(program.pid)
    assert any("cairn.fleet" in line for line in below.values()), below
    program.kill()
    program.wait()
    until = time.monotonic() + 60
    while left := [pid for pid in below if Path(f"/proc/{pid}").exists()]:
        assert time.monotonic() < until, {pid: below[pid] for pid in left}
        time.sleep(0.1)
    again = build(recordings, tmp_path / "store", "--workers", "2")
    assert again["digest"] == in_order["digest"]


def test_recordings_and_store_in_s3(recordings: Path, in_order: dict[str, Any], s3: Any) -> None:
    upload(s3, recordings, "city/recordings")
    report = cairn.fleet.build("s3://walks/city/recordings", "s3://walks/atlas", overlap_m=2.0, tile_m=4.0, margin_m=1.0, workers=2)
    assert report["maps"] == 9 and len(report["atlases"]) == 3
    # Another address, but the same content: the same atlas.
    assert report["digest"] == in_order["digest"]
    again = cairn.fleet.build("s3://walks/city/recordings", "s3://walks/atlas", overlap_m=2.0, tile_m=4.0, margin_m=1.0, ray=False)
    assert again["digest"] == report["digest"]
    assert all(cost["tasks"] == cost["reused"] for cost in again["costs"])


def test_errors_are_told(tmp_path: Path) -> None:
    with pytest.raises(cairn.Error, match="nowhere"):
        cairn.fleet.build(str(tmp_path / "nowhere"), str(tmp_path / "store"), ray=False)
    with pytest.raises(cairn.Error, match="no size"):
        cairn.fleet.build(str(tmp_path), str(tmp_path / "store"), tile_m=-1.0, ray=False)
    with pytest.raises(ValueError, match="recordings"):
        cairn.fleet.fleet_run("{}", "{}")
