"""Tiny ONNX files written by hand: the fields of onnx.proto that one Identity node needs."""

from __future__ import annotations

import numpy as np

__all__ = ["FLOAT", "FLOAT16", "UINT8", "model"]

FLOAT, UINT8, FLOAT16 = 1, 2, 10


def model(path, image, out, metadata=None, constant=None):
    """A file with an input, and an output that is the input or a constant; both are (name, kind, shape)."""
    source, graph = image[0], b""
    if constant is not None:
        source = "c"
        dims = b"".join(_field(1, n) for n in constant.shape)
        raw = constant.astype({FLOAT: "<f4", FLOAT16: "<f2"}[out[1]]).tobytes()
        graph = _field(5, dims + _field(2, out[1]) + _field(8, "c") + _field(9, raw))
    node = _field(1, source) + _field(2, out[0]) + _field(4, "Identity")
    graph = _field(1, node) + _field(2, "g") + graph + _field(11, _value(*image)) + _field(12, _value(*out))
    props = b"".join(_field(14, _field(1, k) + _field(2, v)) for k, v in (metadata or {}).items())
    path.write_bytes(_field(1, 8) + _field(7, graph) + _field(8, _field(1, "") + _field(2, 17)) + props)
    return path


def _field(number, payload):
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


def _value(name, kind, shape):
    dims = b"".join(_field(1, _field(1 if isinstance(n, int) else 2, n)) for n in shape)
    return _field(1, name) + _field(2, _field(1, _field(1, kind) + _field(2, dims)))
