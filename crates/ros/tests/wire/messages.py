"""ROS 2 messages for CycloneDDS, built from the definitions that rosbags carries: none of it is known to Cairn."""

import functools
import types
from dataclasses import dataclass

import numpy as np
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int16, int32, int64, sequence, uint8, uint16, uint32, uint64
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
# Services are two messages; a message without fields has this one in DDS.
# rmw_cyclonedds puts a header before requests and responses.
STORE.register(
    get_types_from_msg("uint64 guid\nint64 seq\nuint8 structure_needs_at_least_one_member", "cyclone/msg/Trigger_Request")
)
STORE.register(get_types_from_msg("uint64 guid\nint64 seq\nbool success\nstring message", "cyclone/msg/Trigger_Response"))
for _name, _fields in {
    "GetParameters_Request": "string[] names",
    "GetParameters_Response": "rcl_interfaces/ParameterValue[] values",
    "SetParameters_Request": "rcl_interfaces/Parameter[] parameters",
    "SetParameters_Response": "rcl_interfaces/SetParametersResult[] results",
}.items():
    STORE.register(get_types_from_msg(f"uint64 guid\nint64 seq\n{_fields}", f"cyclone/msg/{_name}"))
# What is not an image.
STORE.register(get_types_from_msg("uint32[] data", "garbage/msg/Blob"))

BASE = {
    "bool": bool, "string": str, "byte": uint8, "char": uint8, "uint8": uint8, "int8": int8, "uint16": uint16, "int16": int16,
    "uint32": uint32, "int32": int32, "uint64": uint64, "int64": int64, "float32": float32, "float64": float64,
}  # fmt: skip


def _kind(node):
    what, of = node
    if what == Nodetype.BASE:
        return BASE[of[0]]
    if what == Nodetype.NAME:
        return message(of)
    return array[_kind(of[0]), of[1]] if what == Nodetype.ARRAY else sequence[_kind(of[0])]


@functools.cache
def message(name, dds_name=None):
    """The class of a message such as "sensor_msgs/msg/Image", for topics of CycloneDDS.

    CycloneDDS gets the type, under the mangled name that ROS uses on the wire; the bytes are written and read by rosbags,
    which is fast. `message(name)(ros)` wraps a message of rosbags, `.ros` is that message.
    """
    package, kind, short = name.split("/")
    fields = {field: _kind(node) for field, node in STORE.fielddefs[name][1]}
    typename = dds_name or f"{package}::{kind}::dds_::{short}_"
    body = {"__annotations__": fields, "__module__": __name__}
    made = dataclass(types.new_class(short, (IdlStruct,), {"typename": typename}, lambda names: names.update(body)))

    def init(self, ros):
        self.ros = ros

    made.__init__ = init
    made.serialize = lambda self, **_: bytes(STORE.serialize_cdr(self.ros, name))
    made.deserialize = classmethod(lambda cls, data, **_: cls(STORE.deserialize_cdr(data, name)))
    # A writer has gone: there is no message.
    made.deserialize_key = classmethod(lambda cls, data, **_: cls(None))
    return made


def make(name, /, **fields):
    """A message of rosbags: zeros, but for these fields."""

    def of(node):
        what, inner = node
        if what == Nodetype.NAME:
            return make(inner)
        if what == Nodetype.ARRAY:
            return np.zeros(inner[1], dtype=inner[0][1][0])
        if what == Nodetype.SEQUENCE:
            number = inner[0][0] == Nodetype.BASE and inner[0][1][0] != "string"
            return np.zeros(0, dtype=inner[0][1][0]) if number else []
        return {"string": "", "bool": False}.get(inner[0], 0)

    known = STORE.fielddefs[name][1]
    assert set(fields) <= {field for field, _ in known}, (name, fields)
    return STORE.types[name](**{field: fields[field] if field in fields else of(node) for field, node in known})


def stamp(ns):
    """A builtin_interfaces/Time."""
    return make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)


def header(ns, frame):
    """A std_msgs/Header."""
    return make("std_msgs/msg/Header", stamp=stamp(ns), frame_id=frame)


def seconds(of):
    """The time of a header, seconds."""
    return of.stamp.sec + of.stamp.nanosec * 1e-9
