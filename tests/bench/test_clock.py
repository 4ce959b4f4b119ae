"""The draws of the clock's bench: the truth is found, and nothing without it."""

from bench.clock.__main__ import judged
from bench.clock.draws import draw


def test_a_draw_is_found_and_its_log_without_the_film_is_refused():
    flight = draw(3, 30.0, heading_known=True)
    word, off_s = judged(flight, present=True)
    assert word == "found"
    assert off_s < 0.2
    assert judged(flight.without(-150.0, 150.0), present=False)[0] == "refused"
