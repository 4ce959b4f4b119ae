"""The newest snapshot passes from one to many, and nobody waits."""

import os
from contextlib import ExitStack, closing
from dataclasses import replace

import numpy as np
import pytest

from gcs.live_out.hand_over import SNAPSHOT_BYTES, SnapshotReader, SnapshotWriter
from mavlink.geodesy import LocalFrame
from tests.support.snapshots import box, snapshot


@pytest.fixture
def open_writer():
    with ExitStack() as stack:
        yield lambda **how: stack.enter_context(closing(SnapshotWriter(**how)))


def test_a_reader_gets_what_is_newest_and_each_once(open_writer):
    writer = open_writer()
    first, second = SnapshotReader(writer.fd), SnapshotReader(writer.fd)
    assert first.newest() is None
    for frame in range(5):
        writer.put(replace(snapshot(frame, boxes=[box(1, 2)]), origin=LocalFrame(47.0, 8.0)))
    got = first.newest()
    assert (got.frame, got.boxes[0].system_id, got.origin) == (4, 2, LocalFrame(47.0, 8.0))
    assert first.newest() is None
    writer.put(snapshot(5))
    assert [reader.newest().frame for reader in (first, second)] == [5, 5]


def test_a_snapshot_that_is_too_large_leaves_the_one_before(open_writer):
    writer = open_writer()
    reader = SnapshotReader(writer.fd)
    writer.put(snapshot(1))
    rows = tuple(replace(row, name=os.urandom(SNAPSHOT_BYTES // 4).hex()) for row in snapshot().vehicles)
    writer.put(replace(snapshot(2), vehicles=rows))
    assert reader.newest().frame == 1
    assert writer.left_out == 1
    writer.put(snapshot(3))
    assert reader.newest().frame == 3


def test_pictures_are_handed_over_where_they_are_asked_for(open_writer):
    image = np.arange(48 * 64 * 3, dtype=np.uint8).reshape(48, 64, 3)
    writer = open_writer(images=True)
    reader = SnapshotReader(writer.fd, images=True)
    writer.put(snapshot(1, image=image))
    assert np.array_equal(reader.newest().image, image)
    writer.put(snapshot(2))
    assert reader.newest().image is None
    without = open_writer()
    without.put(snapshot(1, image=image))
    assert SnapshotReader(without.fd).newest().image is None


def test_a_picture_that_may_have_been_written_over_is_dropped(open_writer):
    class Interrupted(SnapshotReader):
        """The station writes on just while the picture is copied."""

        @property
        def _images(self):
            for frame in range(2, 5):
                writer.put(snapshot(frame, image=np.full((4, 4, 3), frame, np.uint8)))
            return self.pictures

        @_images.setter
        def _images(self, pictures):
            self.pictures = pictures

    writer = open_writer(images=True)
    reader = Interrupted(writer.fd, images=True)
    writer.put(snapshot(1, image=np.ones((4, 4, 3), np.uint8)))
    assert reader.newest() is None
    assert SnapshotReader(writer.fd, images=True).newest().image.max() == 4
