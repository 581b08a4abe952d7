"""Exceptions of Cairn.

A lost pose or a refused loop is no exception but a value with numbers (`Output.state`). An argument of a wrong type is a
`TypeError`, one out of range or of a wrong shape a `ValueError`, as everywhere in Python.
"""


class Error(Exception):
    """Base of all exceptions of Cairn."""


class SourceError(Error):
    """A recording, stream or calibration file could not be opened or read."""


class RigError(Error, ValueError):
    """A rig is impossible, or lacks a sensor that was asked for."""


class ConfigError(Error, ValueError):
    """A configuration has an unknown entry or a number out of range."""


class FrameError(Error, ValueError):
    """A frame was refused: its time, its images or its IMU samples do not fit. The next one can be processed."""


class DataWarning(UserWarning):
    """The data of frames are implausible: exchanged or wrongly scaled sensors, clocks apart, no depth. They are used as they are."""


class MapError(Error):
    """A saved map could not be read, written or used with this camera."""


class RouteError(Error):
    """A recorded route could not be read."""


class RefusedError(Error):
    """Recording or guidance could not do what was asked; the words are those that the walker hears."""


class TrajectoryError(Error, ValueError):
    """Trajectories cannot be compared: no times agree, or the poses do not determine an alignment."""


class DenseError(Error, ValueError):
    """A depth image, a pose or a setting that a dense volume cannot use."""
