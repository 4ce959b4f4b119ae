"""A classifier of fronts as an ONNX file, written by hand: logits = pixels · weights."""

from __future__ import annotations

import numpy as np

FLOAT, FLOAT16 = 1, 10


def classifier(path, weights, side, *, metadata=None, batch="n", kind=FLOAT, crop=None, plain=False):
    """Write ``crops`` (batch, 3, side, side) → Flatten → MatMul with weights (3 · side · side, classes) → ``logits``.

    ``crop`` is another shape of one input; a plain model gives back what it gets.
    """
    dtype = {FLOAT: "<f4", FLOAT16: "<f2"}[kind]
    dims = b"".join(_field(1, n) for n in weights.shape)
    tensor = dims + _field(2, kind) + _field(8, "w") + _field(9, np.ascontiguousarray(weights, dtype).tobytes())
    nodes = [
        _field(1, "crops") + _field(2, "flat") + _field(4, "Flatten"),
        _field(1, "flat") + _field(1, "w") + _field(2, "logits") + _field(4, "MatMul"),
    ]
    crop = crop or [3, side, side]
    if plain:
        nodes = [_field(1, "crops") + _field(2, "logits") + _field(4, "Identity")]
    ends = _field(11, _value("crops", kind, [batch, *crop]))
    ends += _field(12, _value("logits", kind, [batch, *crop] if plain else [batch, weights.shape[1]]))
    _write(path, b"".join(_field(1, node) for node in nodes) + _field(2, "g") + _field(5, tensor) + ends, metadata)
    return path


def constant(path, shape, output, metadata=None):
    """Write a model that gives the same whatever it sees: ``images`` → ``output0``."""
    dims = b"".join(_field(1, n) for n in output.shape)
    tensor = dims + _field(2, FLOAT) + _field(8, "c") + _field(9, np.ascontiguousarray(output, "<f4").tobytes())
    node = _field(1, "c") + _field(2, "output0") + _field(4, "Identity")
    ends = _field(11, _value("images", FLOAT, shape)) + _field(12, _value("output0", FLOAT, list(output.shape)))
    _write(path, _field(1, node) + _field(2, "g") + _field(5, tensor) + ends, metadata)


def brightest_side(side, classes):
    """Weights whose class k is the mean of the half towards k · 360° / classes clockwise from +x, of all colours."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    halves = {2: (x > 0, x < 0), 4: (x > 0, y > 0, x < 0, y < 0)}[classes]
    return np.stack([np.tile(half.ravel(), 3) / (1.5 * side * side) for half in halves], axis=1)


def _write(path, graph, metadata):
    props = b"".join(_field(14, _field(1, k) + _field(2, v)) for k, v in (metadata or {}).items())
    path.write_bytes(_field(1, 8) + _field(7, graph) + _field(8, _field(1, "") + _field(2, 17)) + props)


# protobuf fields of onnx.proto
def _field(number, payload):
    if isinstance(payload, int):
        return _varint(number << 3) + _varint(payload)
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
