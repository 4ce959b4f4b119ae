"""The table of alarms: whole, told by the operator's page as it is, and with one limit for screen, alarm and docs."""

import importlib.util
from pathlib import Path

import pytest

from gcs.fold.showing import HELD_US
from gcs.health.alarm_rule import CLEARS_AFTER_S, GROWING_S
from gcs.health.condition_alarms import CONDITION_RULES
from gcs.health.link_alarms import LINK_RULES
from gcs.health.proximity_alarms import PAIR_RULES
from gcs.health.station_alarms import LATE_S, STATION_RULES
from gcs.health.vehicle_alarms import VEHICLE_RULES
from vision.stream.pace import STALL_S

PAGE = Path("docs/operations.md")
NAMED = [("NAME: ", rule) for rule in (*VEHICLE_RULES, *CONDITION_RULES)]
NAMED += [*(("NAME and NAME: ", rule) for rule in PAIR_RULES), *(("LINK: ", rule) for rule in LINK_RULES)]
NAMED += [("", rule) for rule in STATION_RULES]
HEAD = "| alarm | level | raised when | over | do |\n|---|---|---|---|---|\n"
RULES = [rule for _, rule in NAMED]


def over(rule):
    """When it is over."""
    if rule.counter is not None:
        return f"{GROWING_S + CLEARS_AFTER_S:g} s after the last"
    return f"{rule.clears_after_s:g} s after" if rule.clears_after_s else "at once"


def line(name, rule):
    """Of the operator's page."""
    detail = ": …" if rule.detail else ""
    return f"| {name}{rule.text}{detail} | {rule.level} | {rule.meaning} | {over(rule)} | {rule.advice} |"


def test_the_operators_page_explains_every_alarm():
    """To change the page, take the lines from what this test shows when it fails."""
    _, _, table = PAGE.read_text(encoding="utf-8").partition(HEAD)
    found, expected = table.split("\n\n")[0].splitlines(), [line(*each) for each in NAMED]
    assert not [each for each in expected if each not in found], "lines that the page lacks"
    assert found == expected


def test_no_two_rules_are_of_the_same_alarm_and_level():
    assert len({(rule.key, rule.level) for rule in RULES}) == len(RULES)


@pytest.mark.parametrize("rule", RULES, ids=[f"{rule.key}, {rule.level}" for rule in RULES])
def test_every_rule_is_complete(rule):
    assert rule.text and rule.meaning and rule.advice and (rule.condition is None) != (rule.counter is None)
    assert not rule.logged_by or importlib.util.find_spec(rule.logged_by), "who writes its events exists"


def test_limits_of_other_packages_are_those_that_are_told():
    (video,) = (rule for rule in RULES if rule.key == "video")
    assert f"no frame for {STALL_S + video.lasts_s:g} s" in video.meaning and STALL_S + video.lasts_s == HELD_US * 1e-6
    assert f"lag below {LATE_S:g} s" in PAGE.read_text(encoding="utf-8")
