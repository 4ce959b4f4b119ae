"""Mission files nobody would write are taken or refused in one line."""

import tomllib

import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.errors import ConfigError
from gcs.mission.mission import Mission, load_mission, parse_mission
from tests.support.bundled import ROOT

GOOD = (ROOT / "tests" / "corpus" / "readers" / "missions" / "mission.toml").read_text(encoding="utf-8")
CORPUS = sorted((ROOT / "tests" / "corpus" / "mission").iterdir())
TABLE = tomllib.loads(GOOD)

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


def file_refused_or_taken(path):
    try:
        assert isinstance(load_mission(path), Mission)
    except ConfigError as error:
        assert str(path) in str(error) and "\n" not in str(error)


def test_the_file_to_start_from_is_good(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(GOOD)
    assert load_mission(path).ugv_ids == (11, 12)


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
    file_refused_or_taken(path)


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_kept_files(path):
    file_refused_or_taken(path)


def test_written_missions_are_read_again(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(tomli_w.dumps(TABLE))
    assert load_mission(path).ugv_ids == (11, 12)
