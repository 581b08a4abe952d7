"""Messages as `cairn-rerun` reads them: written here by the specification of postcard, not by the library."""

import struct

VERSION = struct.pack("<I", 1)


def varint(n):
    out = bytearray()
    while n >= 0x80:
        out.append(n & 0x7F | 0x80)
        n >>= 7
    out.append(n)
    return bytes(out)


def signed(n):
    return varint((n << 1) ^ (n >> 63) & (1 << 64) - 1 if n < 0 else n << 1)


def text(s):
    return varint(len(s.encode())) + s.encode()


def floats(*values):
    return struct.pack(f"<{len(values)}f", *values)


def many(items):
    return varint(len(items)) + b"".join(items)


def frame(message):
    return struct.pack("<I", len(message)) + message


def begin(name):
    return VERSION + frame(varint(0) + text(name))


def at(stamp_ns, number):
    return frame(varint(1) + signed(stamp_ns) + signed(number))


def show(entity, kind, content):
    return frame(varint(2) + text(entity) + varint(kind) + content)


END = frame(varint(3))
RED = bytes([240, 60, 60])


def axes(z_is_up):
    return 0, bytes([z_is_up])


def lens(size, focal, centre):
    return 1, varint(size[0]) + varint(size[1]) + floats(*focal, *centre)


def pose(translation, xyzw, scale=1.0):
    return 2, floats(*translation, *xyzw, scale)


def image(size, gray):
    return 3, varint(size[0]) + varint(size[1]) + varint(len(gray)) + bytes(gray)


def pixels(points):
    return 4, many([floats(*p) for p in points]) + RED


def points(points):
    return 5, many([floats(*p) for p in points]) + RED


def lines(lines):
    return 6, many([many([floats(*p) for p in line]) for line in lines]) + RED


def boxes(boxes):
    return 7, many([floats(*low, *high) for low, high in boxes]) + RED


def words(warning, words):
    return 8, bytes([warning]) + text(words)


def number(value):
    return 9, struct.pack("<d", value)
