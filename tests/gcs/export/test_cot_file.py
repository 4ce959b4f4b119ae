"""Cursor on Target in a file, read by takproto."""

from collections import defaultdict
from itertools import pairwise
from xml.etree import ElementTree

import pytest
import takproto

from tests.support.bundled import SWARM, shortened
from tests.support.command_line import run_gcs


@pytest.mark.slow
def test_takproto_reads_each_event_and_there_is_one_a_second(tmp_path):
    flight = shortened(SWARM, tmp_path / "short-swarm", 60)
    code, _, err = run_gcs("export", flight, "-o", tmp_path / "a.cot")
    assert code == 0, err
    lines = (tmp_path / "a.cot").read_text().splitlines()
    assert len(ElementTree.parse(tmp_path / "a.cot").getroot()) == len(lines) - 3 > 20
    times = defaultdict(list)
    kinds = defaultdict(set)
    for line in lines[2:-1]:
        event = takproto.parse_proto(takproto.xml2proto(line)).cotEvent
        times[event.uid].append(event.sendTime)
        kinds[event.type].add(event.detail.contact.callsign)
        assert 0.5 < event.ce < 5.0
        assert event.staleTime - event.sendTime == 10_000
    assert all(b - a >= 1000 for told in times.values() for a, b in pairwise(told))
    assert kinds["a-f-G-E-V"] >= {"UGV-2", "UGV-6"}
    assert all(name.startswith("unknown ") for name in kinds["a-u-G-E-V"])
    code, _, err = run_gcs("export", flight, "-o", tmp_path / "a.cot")
    assert code
    assert "exists already" in err
