"""Tiny ONNX files written by hand, field by field of onnx.proto."""

from __future__ import annotations

import numpy as np

__all__ = ["FLOAT", "FLOAT16", "UINT8", "field", "model", "value", "write"]

FLOAT, UINT8, FLOAT16 = 1, 2, 10


def model(path, image, out, metadata=None, constant=None):
    """A file with an input, and an output that is the input or a constant; both are (name, kind, shape)."""
    source, graph = image[0], b""
    if constant is not None:
        source = "c"
        dims = b"".join(field(1, n) for n in constant.shape)
        raw = constant.astype({FLOAT: "<f4", FLOAT16: "<f2"}[out[1]]).tobytes()
        graph = field(5, dims + field(2, out[1]) + field(8, "c") + field(9, raw))
    node = field(1, source) + field(2, out[0]) + field(4, "Identity")
    graph = field(1, node) + field(2, "g") + graph + field(11, value(*image)) + field(12, value(*out))
    write(path, graph, metadata)
    return path


def write(path, graph, metadata=None):
    """A file of a graph's fields, with notes."""
    props = b"".join(field(14, field(1, k) + field(2, v)) for k, v in (metadata or {}).items())
    path.write_bytes(field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 17)) + props)


def field(number, payload):
    if isinstance(payload, (int, np.integer)):
        return _varint(number << 3) + _varint(int(payload))
    data = payload.encode() if isinstance(payload, str) else payload
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _varint(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def value(name, kind, shape):
    dims = b"".join(field(1, field(1 if isinstance(n, int) else 2, n)) for n in shape)
    return field(1, name) + field(2, field(1, field(1, kind) + field(2, dims)))
