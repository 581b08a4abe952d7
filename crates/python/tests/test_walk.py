"""Routes: recorded, loaded, followed by words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Walk

import cairn


def test_routes_are_recorded_and_guided_along(long_walk: Walk, tmp_path: Path) -> None:
    slam = cairn.Slam(long_walk.rig, rate_hz=10.0)
    file = tmp_path / "out.route"
    assert slam.guide_state is None and slam.route is None
    assert "ecord" in slam.record(file)
    with pytest.raises(cairn.RefusedError):
        slam.record(tmp_path / "second.route")
    for frame in long_walk.frames:
        slam.track(frame)
    route = slam.stop_recording()
    assert len(route) > 5 and route.metric
    assert route.poses.shape == (len(route), 4, 4) and route.stamps_ns.shape == (len(route),)
    walked = np.linalg.norm(route.positions[-1] - route.positions[0])
    true = np.linalg.norm(long_walk.truth.positions[-1] - long_walk.truth.positions[0])
    assert abs(walked - true) < 0.3
    np.testing.assert_allclose(cairn.Route.load(file).positions, route.positions, atol=1e-12)
    slam.heard()

    slam.finish()
    slam.save(tmp_path / "with-route.map")
    assert [len(r) for r in cairn.load_map(tmp_path / "with-route.map").routes.values()] == [len(route)]

    # Home, walking backwards: what the camera saw on the way out, in reverse.
    slam.guide_home("backwards")
    now = long_walk.frames[-1].stamp
    for k, frame in enumerate(reversed(long_walk.frames)):
        slam.track(frame.image, depth=frame.depth, stamp=now + 0.1 * (k + 1))
    said = [h for h in slam.heard() if isinstance(h, cairn.Said)]
    assert "arrived" in said[-1].text and slam.has_arrived and slam.guide_state is None
    assert said[0].stamp_ns >= long_walk.frames[-1].stamp_ns
    # Out again, and no picture for two seconds: it says stop.
    slam.load_route(file)
    slam.guide_again("home")
    later = now + 6.2
    for k, frame in enumerate(long_walk.frames[:10]):
        slam.track(frame.image, depth=frame.depth, stamp=later + 0.1 * k)
    slam.heard()
    for k in range(60):
        slam.tick(later + 1.0 + 0.05 * k)
    assert slam.guide_state is not None and slam.guide_state.startswith("stopped: ")
    assert any("Stop" in h.text for h in slam.heard() if isinstance(h, cairn.Said))
    assert slam.halt()
    assert slam.guide_state is None


def test_what_cannot_be_served_says_why(long_walk: Walk, tmp_path: Path) -> None:
    slam = cairn.Slam(long_walk.rig)
    for call in (slam.stop_recording, slam.halt, slam.guide_home, slam.guide_again):
        with pytest.raises(cairn.RefusedError):
            call()
    with pytest.raises(cairn.RouteError):
        slam.load_route(tmp_path / "none.route")
    with pytest.raises(cairn.RouteError):
        cairn.Route.load(tmp_path / "none.route")
    with pytest.raises(ValueError, match="facing"):
        slam.guide_home("sideways")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="not a time"):
        slam.tick(float("inf"))
