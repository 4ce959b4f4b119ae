"""Mission files nobody would write are taken or refused in one line; ``python -m bench.fuzz missions`` runs more."""

import tomllib

import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.fuzz.missions import GOOD, MissionScore, fuzz_missions, read_mission
from gcs.errors import ConfigError
from gcs.mission.mission import Mission, load_mission, parse_mission
from tests.support.bundled import ROOT

CORPUS = sorted((ROOT / "tests" / "corpus" / "mission").iterdir())
TABLE = tomllib.loads(GOOD)
# Not refused in one line yet: numbers beyond a float, brackets without end, NUL in a path, the file of a doubled id.
OPEN: set[str] = set()
OPEN_ERRORS = ("none",)

scalars = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.text(max_size=20), st.dates(), st.datetimes()
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


def refused_or_taken(table):
    try:
        assert isinstance(parse_mission(table, "here.toml"), Mission)
    except ConfigError as error:
        assert "here.toml" in str(error) or "system id" in str(error)
    except OverflowError:
        assert "huge_number.toml" in OPEN


def test_the_file_to_start_from_is_good(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(GOOD)
    assert load_mission(path).ugv_ids == (11, 12)


@pytest.mark.slow
def test_drawn_files_are_taken_or_refused():
    score = fuzz_missions(range(400), TABLE)
    assert [line for line in score.failures if not line.startswith(OPEN_ERRORS)] == []
    assert score.refused > 200


@pytest.mark.slow
@given(section=st.sampled_from(sorted(TABLE)), value=values)
@settings(max_examples=150, deadline=None)
def test_any_value_for_a_section(section, value):
    refused_or_taken({**TABLE, section: value})


@pytest.mark.slow
@given(data=st.data(), value=values)
@settings(max_examples=200, deadline=None)
def test_any_value_for_a_key(data, value):
    section = data.draw(st.sampled_from([name for name in TABLE if isinstance(TABLE[name], dict)]))
    key = data.draw(st.sampled_from([*sorted(TABLE[section]), "zoom", "lens", "device"]))
    refused_or_taken({**TABLE, section: {**TABLE[section], key: value}})


@pytest.mark.slow
@given(text=st.text(max_size=200))
@settings(max_examples=100, deadline=None)
def test_any_text_is_taken_or_refused(text, tmp_path_factory):
    path = tmp_path_factory.mktemp("mission") / "mission.toml"
    path.write_bytes((GOOD + text).encode("utf-8", "surrogatepass"))
    score = MissionScore()
    read_mission(path, score)
    assert score.failures == []


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_kept_files(path):
    score = MissionScore()
    read_mission(path, score)
    if path.name in OPEN:
        assert all(line.startswith(OPEN_ERRORS) for line in score.failures)
    else:
        assert score.failures == []


def test_written_missions_are_read_again(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(tomli_w.dumps(TABLE))
    assert load_mission(path).ugv_ids == (11, 12)
