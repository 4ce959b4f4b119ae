import dataclasses
import tomllib

import pytest

from sim.errors import ScenarioError
from sim.world.presets import PRESETS, curved_road, preset
from sim.world.scenario import Blackout, Detector, Fault, Gnss, Ground, Occlusion, Scenario
from sim.world.scenario_file import load_scenario, save_scenario, scenario_from_dict


def full_scenario():
    return Scenario(
        name="full",
        ground=Ground(kind="open", vehicles=4, outside=2, area_m=(50.0, 30.0)),
        occlusions=(Occlusion(vehicle=1, t_s=3.0),),
        blackouts=(Blackout(start_s=1.0, stop_s=2.0),),
        faults=(Fault(vehicle=5, kind="jump", start_s=4.0, size=12.0), Fault(vehicle=0, kind="zero", start_s=2.0)),
    )


@pytest.mark.parametrize("scenario", [full_scenario(), *(make() for make in PRESETS.values())], ids=lambda s: s.name)
def test_a_saved_scenario_is_loaded_equal(scenario, tmp_path):
    save_scenario(scenario, tmp_path / "s.toml")
    assert load_scenario(tmp_path / "s.toml") == scenario
    assert tomllib.loads((tmp_path / "s.toml").read_text())["ground"]["kind"] == scenario.ground.kind


def test_keys_left_out_keep_their_defaults():
    scenario = scenario_from_dict({"seed": 7, "gnss": {"white_m": 2}})
    assert scenario == Scenario(seed=7, gnss=Gnss(white_m=2.0))
    assert isinstance(scenario.gnss.white_m, float)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"duratoin_s": 3.0}, "duratoin_s: no such key; did you mean duration_s?"),
        ({"gnss": {"whitem": 1.0}}, "gnss.whitem: no such key; did you mean white_m?"),
        ({"faults": [{"vehicle": 0, "kind": "silent", "start": 1.0}]}, "faults[0].start: no such key"),
        ({"faults": [{"vehicle": 0, "kind": "silent"}]}, "faults[0]: start_s is missing"),
        ({"ground": {"kind": "round"}}, "must be one of straight, curved, open, formation, parked"),
        ({"seed": "one"}, "seed = 'one': must be a whole number"),
        ({"seed": True}, "must be a whole number"),
        ({"attitude": {"missing": 1}}, "must be true or false"),
        ({"camera": {"distortion": [0.0, 0.0]}}, "must have 5 values"),
        ({"ground": 3}, "ground: must be a table"),
        ({"blackouts": 3}, "must be an array"),
        ({"fps": 1000.0}, "fps = 1000.0 is out of range; give a value from 0.5 to 120"),
        ({"timing": {"rate_min_hz": 9.0}}, "timing.rate_min_hz = 9.0 is out of range"),
        ({"occlusions": [{"vehicle": 9, "t_s": 1.0}]}, "vehicle = 9 of occlusion does not exist; vehicles are 0 to 5"),
    ],
)
def test_a_bad_scenario_is_refused_and_says_why(values, text):
    with pytest.raises(ScenarioError) as error:
        scenario_from_dict(values)
    assert text in str(error.value)


def test_a_bad_file_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.toml: cannot be read"):
        load_scenario(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("seed = = 1")
    with pytest.raises(ScenarioError, match=r"bad\.toml: is not valid TOML"):
        load_scenario(tmp_path / "bad.toml")
    (tmp_path / "key.toml").write_text("sede = 1")
    with pytest.raises(ScenarioError, match=r"key\.toml: sede: no such key; did you mean seed\?"):
        load_scenario(tmp_path / "key.toml")


def test_presets_by_name():
    assert preset("curved-road") == curved_road()
    with pytest.raises(ScenarioError, match="did you mean curved-road"):
        preset("curved_rod")


def test_every_knob_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Detector().miss = 1.0
