"""Detection on the next frames of a video ahead of their use, several at once.

Decoding, scaling and the networks run without Python's lock, so that threads use all cores; what comes out is the same
and in the same order as one by one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor

from vision.detect.detections import Detections
from vision.detect.detector import Detector
from vision.video.video import Frame


def look_ahead(
    frames: Iterable[Frame], detector: Detector, gsd_m: Callable[[Frame], float | None], *, workers: int = 2
) -> Generator[tuple[Frame, Detections], None, None]:
    """Frames with what is seen in them, in order.

    Closing the iterator ends the threads after the frames that they are at.

    Args:
        frames: decoded as they are asked for.
        detector: may be asked from several threads at once.
        gsd_m: metres on the ground per pixel of a frame, None unknown; asked once for each, in order.
        workers: frames in work at once, by threads of their own; 0: each is looked at when it is asked for.
    """
    if not workers:
        for frame in frames:
            yield frame, detector.detect(frame.image, gsd_m=gsd_m(frame))
        return
    waiting: deque[tuple[Frame, Future[Detections]]] = deque()
    with ThreadPoolExecutor(workers, thread_name_prefix="detect") as pool:
        try:
            for frame in frames:
                waiting.append((frame, pool.submit(detector.detect, frame.image, gsd_m=gsd_m(frame))))
                # one frame more than workers, so that none waits for the decoder
                if len(waiting) > workers + 1:
                    yield _first(waiting)
            while waiting:
                yield _first(waiting)
        finally:
            for _, found in waiting:
                found.cancel()


def _first(waiting: deque[tuple[Frame, Future[Detections]]]) -> tuple[Frame, Detections]:
    frame, found = waiting.popleft()
    return frame, found.result()
