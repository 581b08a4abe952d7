"""What a type checker sees. `tools/test_python` runs mypy and pyright, both strict, on this file; pytest runs it too."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from typing_extensions import assert_never

import cairn


def words(state: cairn.State) -> str:
    """Every state is handled: `assert_never` is an error of the checker otherwise."""
    match state:
        case cairn.Starting(have, need):
            return f"{have} of {need}"
        case cairn.Tracking():
            return "tracking"
        case cairn.Coasting(since_s, _) | cairn.RotationOnly(since_s, _):
            return f"{since_s:.1f} s"
        case cairn.Lost(inliers, need):
            return f"{inliers} of {need}"
        case _:
            assert_never(state)


def moved(event: cairn.Event) -> cairn.Similarity | None:
    match event:
        case cairn.MapCreated():
            return None
        case cairn.LoopClosed(_, _, _, similarity):
            return similarity
        case cairn.MapsMerged(into_from=similarity):
            return similarity
        case cairn.ScaleChanged(_, similarity) | cairn.GravityAligned(_, similarity):
            return similarity
        case _:
            assert_never(event)


def test_states_and_events_are_unions() -> None:
    camera = cairn.Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
    slam = cairn.Slam(cairn.Rig(camera, depth_scale=0.001), "rgbd", {"front_end": {"orb": {"features": 500}}})
    image: npt.NDArray[np.uint8] = np.zeros((48, 64), np.uint8)
    output: cairn.Output = slam.track(image, depth=np.zeros((48, 64), np.float32), stamp=0.0)
    pose: npt.NDArray[np.float64] | None = output.world_from_body
    assert pose is None and words(output.state).startswith("0 of")
    assert [moved(event) for event in slam.events()] == []
    heard: list[cairn.Said | cairn.Sound] = slam.heard()
    assert heard == []
