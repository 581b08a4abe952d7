"""Visual-inertial SLAM on numpy arrays; records the route you walked and guides you back along it.

Track a recording or a simulated world:

>>> import cairn
>>> source = cairn.open("sim:demo?sensor=rgbd&resolution=320x240&rate=10&duration=1&detail=0.3")
>>> slam = cairn.Slam.for_source(source)
>>> for frame in source:
...     output = slam.track(frame)
>>> slam.finish()
>>> slam.accuracy(source.truth).ate_rmse_m < 0.05
True

Images of a camera of your own go in as arrays: `slam.track(image, right=..., depth=..., imu=..., stamp=...)`. Lengths are
metres, angles radians, times seconds (`stamp`) or nanoseconds (`stamp_ns`). Transforms are named `a_from_b` and map
coordinates of `b` to coordinates of `a`; quaternions are x, y, z, w. A camera has x to the right, y down, z forward.
"""

from typing import Union

from cairn._cairn import (
    Camera,
    Coasting,
    Config,
    DenseVolume,
    Evaluation,
    Events,
    Evidence,
    Frame,
    GravityAligned,
    Imu,
    ImuBatch,
    KeyFrames,
    Landmarks,
    LoopClosed,
    Lost,
    Map,
    MapCreated,
    MapsMerged,
    Mesh,
    Output,
    Rig,
    RotationOnly,
    Route,
    Said,
    Scale,
    ScaleChanged,
    Similarity,
    Slam,
    Sound,
    Source,
    Starting,
    Tracking,
    Trajectory,
    Voxels,
    __version__,
    load_map,
    open,
)
from cairn._errors import (
    ConfigError,
    DataWarning,
    DenseError,
    Error,
    FrameError,
    MapError,
    RefusedError,
    RigError,
    RouteError,
    SourceError,
    TrajectoryError,
)

State = Union[Starting, Tracking, Coasting, RotationOnly, Lost]
"""The state of tracking, with its numbers."""

Event = Union[MapCreated, LoopClosed, MapsMerged, ScaleChanged, GravityAligned]
"""What became of a map."""

Heard = Union[Said, Sound]
"""What the walker hears."""

__all__ = [
    "Camera",
    "Coasting",
    "Config",
    "ConfigError",
    "DataWarning",
    "DenseError",
    "DenseVolume",
    "Error",
    "Evaluation",
    "Event",
    "Events",
    "Evidence",
    "Frame",
    "FrameError",
    "GravityAligned",
    "Heard",
    "Imu",
    "ImuBatch",
    "KeyFrames",
    "Landmarks",
    "LoopClosed",
    "Lost",
    "Map",
    "MapCreated",
    "MapError",
    "MapsMerged",
    "Mesh",
    "Output",
    "RefusedError",
    "Rig",
    "RigError",
    "RotationOnly",
    "Route",
    "RouteError",
    "Said",
    "Scale",
    "ScaleChanged",
    "Similarity",
    "Slam",
    "Sound",
    "Source",
    "SourceError",
    "Starting",
    "State",
    "Tracking",
    "Trajectory",
    "TrajectoryError",
    "Voxels",
    "__version__",
    "load_map",
    "open",
]

# The exceptions and the warning are shown, and pickled, as those of the package.
for _error in (
    ConfigError,
    DataWarning,
    DenseError,
    Error,
    FrameError,
    MapError,
    RefusedError,
    RigError,
    RouteError,
    SourceError,
    TrajectoryError,
):
    _error.__module__ = "cairn"
del _error
