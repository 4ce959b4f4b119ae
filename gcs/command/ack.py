"""The autopilot's answer to a command: its result and its texts."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega

ACCEPTED, UNSUPPORTED, FAILED, INT_ONLY = 0, 3, 4, 8
_NOT_KNOWN = (UNSUPPORTED, FAILED, INT_ONLY)
"""Results of autopilots that do not have a command; ArduPilot answers FAILED where UNSUPPORTED is meant."""
_NO_PROGRESS = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAck:
    """The end of one command."""

    result: int | None
    """MAV_RESULT, None when nothing came."""
    progress: int = _NO_PROGRESS
    """Percent done, 255: not reported."""
    texts: tuple[str, ...] = ()
    """STATUSTEXT while it was carried out: text from the air, never markup."""
    reason: str = "no answer"
    """Reason why there is no result."""

    @property
    def accepted(self) -> bool:
        """True if the autopilot does it."""
        return self.result == ACCEPTED

    @property
    def not_known(self) -> bool:
        """True if another way to the same end is worth a try."""
        return self.result in _NOT_KNOWN

    @property
    def words(self) -> str:
        """``accepted``, ``refused (DENIED): requires position``, ``no answer``."""
        texts = "; ".join(dict.fromkeys(self.texts))
        if self.result is None:
            return self.reason + (f": {texts}" if texts else "")
        entry = ardupilotmega.enums["MAV_RESULT"].get(self.result)
        name = str(entry.name).removeprefix("MAV_RESULT_") if entry is not None else f"result {self.result}"
        at = f" at {self.progress} %" if 0 < self.progress <= 100 and not self.accepted else ""
        head = "accepted" if self.accepted else f"refused ({name}{at})"
        return f"{head}: {texts}" if texts and not self.accepted else head
