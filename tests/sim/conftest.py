"""Bodies that tests of reports, boxes and faults ask for again and again."""

import pytest

from sim.world import world


@pytest.fixture(scope="session")
def _moved():
    return {}


@pytest.fixture
def moved_once(monkeypatch, _moved):
    """Moves equal bodies once, which takes a third of a second: reports, boxes and faults change no motion."""
    simulate = world.simulate_actors

    def kept(scenario, t, rng):
        about = scenario.seed, scenario.duration_s, scenario.ground, scenario.targets, scenario.camera, scenario.flight
        key = repr((about, scenario.ugv_ids, len(t)))
        if key not in _moved:
            _moved[key] = simulate(scenario, t, rng)
        return _moved[key]

    monkeypatch.setattr(world, "simulate_actors", kept)
