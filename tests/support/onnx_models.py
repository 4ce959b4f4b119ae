"""Tiny ONNX models, written by hand field by field of onnx.proto: any, classifiers of fronts, YOLO detectors."""

from __future__ import annotations

import numpy as np

from vision.detect.detector import open_detector

FLOAT, UINT8, FLOAT16 = 1, 2, 10
NAMES = {"names": "{0: 'plane', 1: 'small vehicle', 2: 'storage tank'}"}
FIXED = [1, 3, 64, 64]
ANCHORS = 84  # of a canvas of 64 x 64: 8² + 4² + 2²
ANY = ["batch", 3, "height", "width"]


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


def classifier(path, weights, side, *, metadata=None, batch="n", kind=FLOAT, crop=None, plain=False):
    """Write ``crops`` (batch, 3, side, side) → Flatten → MatMul with weights (3 · side · side, classes) → ``logits``.

    ``crop`` is another shape of one input; a plain model gives back what it gets.
    """
    dtype = {FLOAT: "<f4", FLOAT16: "<f2"}[kind]
    dims = b"".join(field(1, n) for n in weights.shape)
    tensor = dims + field(2, kind) + field(8, "w") + field(9, np.ascontiguousarray(weights, dtype).tobytes())
    nodes = [
        field(1, "crops") + field(2, "flat") + field(4, "Flatten"),
        field(1, "flat") + field(1, "w") + field(2, "logits") + field(4, "MatMul"),
    ]
    crop = crop or [3, side, side]
    if plain:
        nodes = [field(1, "crops") + field(2, "logits") + field(4, "Identity")]
    ends = field(11, value("crops", kind, [batch, *crop]))
    ends += field(12, value("logits", kind, [batch, *crop] if plain else [batch, weights.shape[1]]))
    write(path, b"".join(field(1, node) for node in nodes) + field(2, "g") + field(5, tensor) + ends, metadata)
    return path


def constant(path, shape, output, metadata=None):
    """Write a model that gives the same whatever it sees: ``images`` → ``output0``."""
    dims = b"".join(field(1, n) for n in output.shape)
    tensor = dims + field(2, FLOAT) + field(8, "c") + field(9, np.ascontiguousarray(output, "<f4").tobytes())
    node = field(1, "c") + field(2, "output0") + field(4, "Identity")
    ends = field(11, value("images", FLOAT, shape)) + field(12, value("output0", FLOAT, list(output.shape)))
    write(path, field(1, node) + field(2, "g") + field(5, tensor) + ends, metadata)


def brightest_side(side, classes):
    """Weights whose class k is the mean of the half towards k · 360° / classes clockwise from +x, of all colours."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    halves = {2: (x > 0, x < 0), 4: (x > 0, y > 0, x < 0, y < 0)}[classes]
    return np.stack([np.tile(half.ravel(), 3) / (1.5 * side * side) for half in halves], axis=1)


def raw(*anchors, classes=3, n=ANCHORS):
    """[1, 4 + classes + 1, n] with given anchors."""
    out = np.zeros((1, 4 + classes + 1, n))
    for k, (cx, cy, w, h, cls, score, angle) in enumerate(anchors):
        out[0, [0, 1, 2, 3, 4 + cls, -1], k] = (cx, cy, w, h, score, angle)
    return out


def suppressed(*boxes, most=30):
    """[1, most, 7] with given boxes, zeros below."""
    out = np.zeros((1, most, 7))
    for k, (cx, cy, w, h, cls, score, angle) in enumerate(boxes):
        out[0, k] = (cx, cy, w, h, score, cls, angle)
    return out


def yolo(tmp_path, out, metadata=NAMES, *, shape=FIXED, told=None, kind=FLOAT, **options):
    """A detector of a constant output; ``told`` is the shape that the file claims for it."""
    path = model(
        tmp_path / "y.onnx", ("images", kind, shape), ("output0", kind, told or list(out.shape)), metadata, out
    )
    return open_detector(path, **options)


def black(width=128, height=64):
    return np.zeros((height, width, 3), np.uint8)
