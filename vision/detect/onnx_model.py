"""An ONNX file opened by onnxruntime, and its metadata."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path

import onnxruntime as ort
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors

from infra.plain_text import plain
from vision.errors import ModelError

RUN_ERRORS = (
    ort_errors.Fail,
    ort_errors.InvalidArgument,
    ort_errors.InvalidGraph,
    ort_errors.InvalidProtobuf,
    ort_errors.NoSuchFile,
    ort_errors.NotImplemented,
    ort_errors.NoModel,
    ort_errors.RuntimeException,
    MemoryError,
    IndexError,
    ValueError,
)
"""All that onnxruntime raises, on loading as on running; the last three for sizes that it cannot have."""
MAX_BYTES = 1 << 30
"""Maximum bytes of a file: four times the largest YOLO."""
MAX_WORDS = 300
MAX_NOTES = 1 << 20
"""Letters of a table in the notes: a thousand classes take 30,000."""


def open_session(path: Path, providers: Sequence[str], threads: int) -> ort.InferenceSession:
    """Load an ONNX file.

    Raises:
        ModelError: no such file, not an ONNX model, or a provider that is not installed.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; give the path of an ONNX detector, or none for the bundled one")
    missing = set(providers) - set(ort.get_available_providers())
    if missing:
        installed = ", ".join(ort.get_available_providers())
        raise ModelError(f"{', '.join(sorted(missing))}: not offered by this onnxruntime; choose from {installed}")
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # between images its threads would wait by spinning: twice the processor time, taken from who receives telemetry
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    if path.stat().st_size > MAX_BYTES:
        raise ModelError(f"{path}: {path.stat().st_size} bytes are more than the {MAX_BYTES} that a model may have")
    try:
        session = ort.InferenceSession(str(path), options, providers=list(providers), enable_fallback=0)
        described(session)
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: the names of its inputs and outputs are no text") from error
    except RUN_ERRORS as error:
        raise ModelError(f"{path}: cannot be loaded as an ONNX model: {why(error)}") from error
    return session


def why(error: Exception) -> str:
    """Error of onnxruntime in a line; it may be pages of the file's own words."""
    return plain(" ".join(str(error).split()))[:MAX_WORDS]


def metadata(session: ort.InferenceSession) -> dict[str, str]:
    """The file's own notes; none where they are no text."""
    try:
        return dict(session.get_modelmeta().custom_metadata_map)
    except UnicodeDecodeError:
        return {}


def table(text: str) -> dict[object, object]:
    """A table written as Python text into the notes, ``{'nms': True, …}`` or a list; empty for an empty text.

    Raises:
        ValueError: it is neither.
    """
    if not text:
        return {}
    if len(text) > MAX_NOTES:
        raise ValueError(f"is a table of {len(text)} letters")
    try:
        value = ast.literal_eval(text)
        return dict(value) if isinstance(value, dict) else dict(enumerate(value))
    except (SyntaxError, TypeError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"is no table: {text[:80]!r}") from error


def described(session: ort.InferenceSession) -> str:
    """Inputs and outputs, as ``images [1, 3, 640, 640] float → output0 [1, 20, 8400] float``."""

    def listed(values: Sequence[ort.NodeArg]) -> str:
        return ", ".join(f"{v.name} {shape_text(v.shape)} {v.type.removeprefix('tensor(').rstrip(')')}" for v in values)

    return f"{listed(session.get_inputs())} → {listed(session.get_outputs())}"


def shape_text(shape: Sequence[object]) -> str:
    """``[1, 3, height, width]``; a side without a name is ?."""
    return "[" + ", ".join("?" if n is None else str(n) for n in shape) + "]"
