"""A box without a name that may be one of ours of which nobody knows where it is: told wherever boxes are told."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import pytest

from gcs.export.cot import cot_event
from gcs.export.job import ExportJob
from gcs.export.maps.geojson import GeoJsonExport
from gcs.missing import may_be
from gcs.session.box_table import json_row
from tests.support.alarm_scenes import UGV, filmed


@pytest.fixture(scope="module")
def silent():
    """One vehicle's positions stop after 6 s; 5 s later there is a box that nobody else has."""
    scene = filmed(6)
    next(vehicle for vehicle in scene.vehicles if vehicle.system_id == UGV).sends = "ha"
    scene.hidden, scene.stranger = {UGV}, (0.0, 8.0)
    return scene.run(5, filmed=True).last


@pytest.fixture(scope="module")
def unnamed(silent):
    return next(box for box in silent.boxes if not box.system_id)


def test_it_says_who_it_may_be_and_why_and_is_no_sure_stranger(silent, unnamed):
    assert re.fullmatch(r"may be UGV-11: no position for [45] s", may_be(silent, unnamed))
    assert unnamed.none_of_ours < 0.9


@pytest.mark.parametrize(
    ("confidences", "words"),
    [
        ({11: 0.3, 12: 0.2}, "may be UGV-11: no position for 9 s"),
        ({12: 0.2, 11: 0.2}, "may be UGV-11 or UGV-12: none of them tells where it is"),
        ({12: 0.17, 14: 0.15, 11: 0.18}, "may be UGV-11, UGV-12 or UGV-14: none of them tells where it is"),
        ({14: 0.12, 11: 0.12, 12: 0.12}, "may be UGV-11, UGV-12, UGV-14 or another: none of them tells where it is"),
    ],
)
def test_those_that_nothing_tells_apart_are_told_together(silent, unnamed, confidences, words):
    candidate = replace(unnamed.candidates[0], missing="no position for 9 s")
    candidates = tuple(replace(candidate, system_id=i, confidence=p) for i, p in confidences.items())
    assert may_be(silent, replace(unnamed, candidates=candidates, none_of_ours=0.45)) == words


def test_named_and_stated_boxes_may_be_nobody_else(silent, unnamed):
    assert may_be(silent, replace(unnamed, stated=True)) == may_be(silent, replace(unnamed, system_id=12)) == ""


def test_where_all_vehicles_report_nobody_may_be_one(silent, unnamed):
    known = tuple(replace(each, missing="") for each in unnamed.candidates)
    assert may_be(silent, replace(unnamed, candidates=known)) == ""
    assert "may_be" not in json.loads(json_row(silent, replace(unnamed, candidates=known)))


def test_files_and_messages_have_the_same_words(silent, unnamed, tmp_path):
    words = may_be(silent, unnamed)
    export = GeoJsonExport(ExportJob(path=tmp_path / "boxes.geojson", name="flight", video=None, truth=None))
    export.write(silent)
    export.close()
    told = json.loads((tmp_path / "boxes.geojson").read_text())["features"]
    event = ElementTree.fromstring(cot_event(silent, unnamed, source="flight"))
    assert [each["properties"]["may_be"] for each in told if each["properties"]["track_id"] == unnamed.track_id] == [
        words
    ]
    assert event.find("detail/__rollcall").get("may_be") == json.loads(json_row(silent, unnamed))["may_be"] == words
