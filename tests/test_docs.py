"""The examples in documents and docstrings are true."""

import doctest
import importlib
import re
import tomllib
from pathlib import Path

import pytest

from assoc.hypotheses.bias_memory import BIAS_STD_M, BIAS_TAU_S
from assoc.params import IdentifierParams
from gcs.mission.mission import parse_mission
from tests.support.bundled import CURVED_ROAD

PRODUCT = ("gcs", "mavlink", "vision", "assoc", "sim", "infra")
WITH_EXAMPLES = sorted(
    path for package in PRODUCT for path in Path(package).rglob("*.py") if ">>> " in path.read_text(encoding="utf-8")
)


MISSIONS = [
    (page, block)
    for page in ("README.md", "docs/operations.md", "docs/mission.md")
    for block in re.findall(r"^ *```toml\n(.*?)```", Path(page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    if "[uav]" in block
]


@pytest.mark.parametrize(("page", "block"), MISSIONS, ids=[page for page, _ in MISSIONS])
def test_missions_in_documents_can_be_flown_as_they_stand(page, block):
    mission = parse_mission(tomllib.loads(block), page)
    assert mission.links.telemetry and mission.ugv and all(view.video for view in mission.view)


def test_worked_example_of_the_identity_document():
    result = doctest.testfile(str(Path("docs/identity.md").resolve()), module_relative=False)
    assert result.attempted >= 9
    assert result.failed == 0


def test_what_the_identity_document_says_is_known_before_is_what_is_assumed():
    page = Path("docs/identity.md").read_text(encoding="utf-8")
    table = page.partition("## What is estimated")[2].partition("\n## ")[0]
    p = IdentifierParams()
    for told in (
        f"| {p.yaw_std_deg:g}°, {p.yaw_rate_std_deg_s:g}°/s;",
        f"| {p.tilt_std_deg:g}° |",
        f"| {p.position_std_m:g} m, {p.height_std_m:.1f} m |",
        f"| {p.time_offset_std_s:g} s; {p.unknown_offset_std_s:g} s where",
        f"| {p.bias_m:g} m, going round in {p.bias_tau_s:g} s; learnt, "
        f"{BIAS_STD_M[0]:g} to {BIAS_STD_M[-1]:g} m and {BIAS_TAU_S[0]:g} to {BIAS_TAU_S[-1]:g} s |",
        f"`threshold`, {p.threshold:g} |",
    ):
        assert told in table, told


@pytest.mark.parametrize("path", WITH_EXAMPLES, ids=str)
def test_examples_in_docstrings_are_true(path, tmp_path, monkeypatch):
    module = importlib.import_module(".".join(path.with_suffix("").parts))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.tlog").write_bytes(CURVED_ROAD.joinpath("telemetry.tlog").read_bytes())
    result = doctest.testmod(module)
    assert result.failed == 0
