import dataclasses
import tomllib

import pytest

from sim.errors import ScenarioError
from sim.world.presets import PRESETS, curved_road, preset
from sim.world.scenario import Blackout, Gnss, Occlusion, Scenario, ScenarioDetector, ScenarioFault, ScenarioGround
from sim.world.scenario_file import load_scenario, parse_scenario, save_scenario


def full_scenario():
    return Scenario(
        name="full",
        ground=ScenarioGround(kind="open", vehicles=4, outside=2, area_m=(50.0, 30.0)),
        occlusions=(Occlusion(vehicle=1, t_s=3.0),),
        blackouts=(Blackout(start_s=1.0, stop_s=2.0),),
        faults=(
            ScenarioFault(vehicle=5, kind="jump", start_s=4.0, size=12.0),
            ScenarioFault(vehicle=0, kind="zero", start_s=2.0),
        ),
    )


@pytest.mark.parametrize("scenario", [full_scenario(), *(make() for make in PRESETS.values())], ids=lambda s: s.name)
def test_a_saved_scenario_is_loaded_equal(scenario, tmp_path):
    save_scenario(scenario, tmp_path / "s.toml")
    assert load_scenario(tmp_path / "s.toml") == scenario
    assert tomllib.loads((tmp_path / "s.toml").read_text())["ground"]["kind"] == scenario.ground.kind


def test_keys_left_out_keep_their_defaults():
    scenario = parse_scenario({"seed": 7, "gnss": {"white_m": 2}}, "s.toml")
    assert scenario == Scenario(seed=7, gnss=Gnss(white_m=2.0))
    assert isinstance(scenario.gnss.white_m, float)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"duratoin_s": 3.0}, "s.toml: unknown key 'duratoin_s'; did you mean duration_s?"),
        ({"gnss": {"whitem": 1.0}}, "s.toml: [gnss]: unknown key 'whitem'; did you mean white_m?"),
        (
            {"faults": [{"vehicle": 0, "kind": "silent", "start": 1.0}]},
            "s.toml: [[faults]] number 1: unknown key 'start'; did you mean start_s?",
        ),
        ({"faults": [{"vehicle": 0, "kind": "silent"}]}, "s.toml: [[faults]] number 1: start_s is missing"),
        (
            {"ground": {"kind": "round"}},
            "[ground]: kind is 'round'; 'bays' or 'curved' or 'formation' or 'open' or 'parked' or 'straight' "
            "is needed",
        ),
        ({"seed": "one"}, "s.toml: seed is 'one'; a whole number is needed"),
        ({"seed": True}, "seed is True; a whole number is needed"),
        ({"attitude": {"missing": 1}}, "s.toml: [attitude]: missing is 1; true or false is needed"),
        (
            {"camera": {"distortion": [0.0, 0.0]}},
            "[camera]: distortion is [0, 0]; a list of 5 numbers is needed",
        ),
        ({"ground": 3}, "s.toml: [ground] must be a table of keys and values"),
        ({"blackouts": 3}, "blackouts is 3; a list of tables is needed"),
        ({"fps": 1000.0}, "s.toml: fps is 1000; it must lie between 0.5 and 120"),
        ({"timing": {"rate_min_hz": 9.0}}, "[timing]: rate_min_hz is 9.0; it must not be above rate_max_hz, 5"),
        (
            {"occlusions": [{"vehicle": 9, "t_s": 1.0}]},
            "s.toml: scenario: vehicle = 9 of occlusion does not exist; vehicles are 0 to 5",
        ),
    ],
)
def test_a_bad_scenario_is_refused_and_says_why(values, text):
    with pytest.raises(ScenarioError) as error:
        parse_scenario(values, "s.toml")
    assert text in str(error.value)


def test_a_bad_file_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.toml: cannot be read"):
        load_scenario(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("seed = = 1")
    with pytest.raises(ScenarioError, match=r"bad\.toml: not valid TOML"):
        load_scenario(tmp_path / "bad.toml")
    (tmp_path / "key.toml").write_text("sede = 1")
    with pytest.raises(ScenarioError, match=r"key\.toml: unknown key 'sede'; did you mean seed\?"):
        load_scenario(tmp_path / "key.toml")


def test_presets_by_name():
    assert preset("curved-road") == curved_road()
    with pytest.raises(ScenarioError, match="did you mean curved-road"):
        preset("curved_rod")


def test_every_knob_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        ScenarioDetector().miss = 1.0
