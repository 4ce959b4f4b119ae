"""One link read by itself, as the receiving process reads all of its links."""

import select
import time

from mavlink.links.kinds import open_link

STEP_S = 0.05


class LinkReader:
    """A link that can also be waited for."""

    def __init__(self, link, index=0):
        self.link = link
        self._index = index

    def __getattr__(self, name):
        return getattr(self.link, name)

    def read(self, timeout_s):
        """Packets that have come; empty after the timeout and when closed."""
        stop_s = time.monotonic() + timeout_s
        while True:
            self.link.maintain()
            batch = self.link.read_batch()
            left_s = stop_s - time.monotonic()
            if batch.frames or left_s <= 0.0:
                return batch.packets(self._index)
            if self.link.fds:
                select.select(self.link.fds, [], [], min(left_s, STEP_S))
            else:
                time.sleep(min(left_s, STEP_S))


def open_reader(url, index=0):
    return LinkReader(open_link(url), index)
