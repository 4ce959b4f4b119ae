"""Alarms of several cameras are checked each with the flight of the camera that it names."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from bench.statements import checker
from gcs.snapshot import Alarm
from tests.support.snapshots import snapshot


@dataclass(frozen=True)
class Moment:
    snapshot: object


@pytest.mark.parametrize(
    ("kind", "system_id", "text", "checked"),
    [
        ("identity", 11, "UAV-2: UGV-11: contradicts", [(2, 11, "UGV-11: contradicts")]),
        ("video", 2, "UAV-2: no video comes", [(2, 0, "no video comes")]),
        ("vehicle", 11, "UGV-11: no heartbeat", [(1, 11, "UGV-11: no heartbeat")]),
        ("vehicle", 2, "UAV-2: no heartbeat", []),
    ],
)
def test_an_alarm_is_checked_without_the_camera_s_name(monkeypatch, kind, system_id, text, checked):
    alarm = Alarm(key="k", level="alarm", kind=kind, text=text, advice="", since_us=0, system_id=system_id)
    shown, found = replace(snapshot(), alarms=(alarm,)), []
    flights = [SimpleNamespace(uav_id=uav_id, moments=[Moment(shown)]) for uav_id in (1, 2)]
    views = [SimpleNamespace(name=name, loop=SimpleNamespace(latest=shown)) for name in ("UAV", "UAV-2")]
    monkeypatch.setattr(checker, "check_missing_alarms", lambda *_: ())
    monkeypatch.setattr(
        checker, "check_sentence", lambda flown, said: found.append((flown.uav_id, said.system_id, said.text)) or ()
    )
    list(checker._alarms_beside(shown, flights[0], flights, views))
    assert found == checked
