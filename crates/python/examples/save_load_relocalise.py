"""Maps a place, saves the map, and finds the way into it again: another walk, begun elsewhere, is localised in the map
without changing it.
"""

from __future__ import annotations

import cairn

WORLD = "sim:demo?seed=5&sensor=rgbd&resolution=320x240&rate=10&detail=0.5"

source = cairn.open(WORLD + "&duration=8")
slam = cairn.Slam.for_source(source)
slam.record("out.route")
for frame in source:
    slam.track(frame)
route = slam.stop_recording()
slam.finish()
size = slam.save("walk.map")
print(f"saved     {slam.map.key_frame_count} key frames and a route of {len(route)} points, {size} bytes")

# It begins 4 s along the way, faster, and with the camera held 10 cm higher.
source = cairn.open(WORLD + "&start=4&duration=3&speed=1.2&height=1.4")
slam = cairn.Slam.for_source(source, map="walk.map", localize_only=True)
version = slam.map.version
found = [slam.track(frame).world_from_body is not None for frame in source]
assert source.truth is not None
print(f"localised {sum(found)} of {len(found)} frames, {slam.accuracy(source.truth)}")
print(f"unchanged {slam.map.version == version}, routes {cairn.load_map('walk.map').routes}")
if not (found[0] or found[1]) or slam.map.version != version:
    raise SystemExit("the place was not recognised, or the map was changed")
