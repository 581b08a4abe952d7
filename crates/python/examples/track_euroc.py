"""Tracks a recording in EuRoC layout with all its sensors, and prints the error against its ground truth.

python track_euroc.py FOLDER [FRAMES]
"""

from __future__ import annotations

import sys

import cairn


def main(folder: str, frames: int | None) -> None:
    # The kind of the recording and its calibration files are found by looking into the folder.
    source = cairn.open(folder, frames=frames)
    print(f"source    {source.name}")

    # Two cameras and an IMU in this recording: stereo, with gravity known once the IMU is initialised.
    slam = cairn.Slam.for_source(source)
    tracked = 0
    for frame in source:
        output = slam.track(frame)
        match output.state:
            # Not an exception: the numbers say how far it is from a pose.
            case cairn.Starting(have, need):
                print(f"{output.stamp:.3f} starting: {have} of {need} points")
            case cairn.Lost(inliers, need):
                print(f"{output.stamp:.3f} lost: {inliers} of {need} inliers")
            case _:
                tracked += 1
    # Mapping ends its work, and the whole map is adjusted once more.
    slam.finish()

    print(f"map       {slam.map.key_frame_count} key frames, {slam.map.landmark_count} landmarks, {tracked} frames tracked")
    print(f"length    {slam.trajectory().length_m:.3f} m, metric: {slam.is_metric}")
    for event in slam.events():
        print(f"event     {event}")
    if source.truth is not None:
        print(f"error     {slam.accuracy(source.truth)}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None)
