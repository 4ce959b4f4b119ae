"""A classifier of fronts as an ONNX file, written by hand: logits = pixels · weights."""

from __future__ import annotations

import numpy as np

from tests.support.onnx_bytes import FLOAT, FLOAT16, field, value, write


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
