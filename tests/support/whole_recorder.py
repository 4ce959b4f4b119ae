"""A recorder that writes the telemetry as well, which in a flight the process of the links does."""

from gcs.session.recorder import Recorder
from infra.files.disk import OS_DISK
from mavlink.tlog.writer import TlogWriter


class WholeRecorder(Recorder):
    def __init__(self, parent, mission, *, video, disk=OS_DISK):
        super().__init__(parent, mission, video=video, disk=disk)
        self._tlog = TlogWriter(self.tlog_path, disk=disk)
        self.packet = self._tlog.write

    def states(self, telemetry=None):
        return super().states(self._tlog.state)

    def close(self, telemetry=None, **notes):
        self._tlog.close()
        return super().close(**notes)
