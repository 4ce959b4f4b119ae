"""When a thing is tried or told again."""

from infra.reporting import Backoff


def test_trying_again_takes_longer_each_time():
    backoff = Backoff(first_s=1.0, most_s=4.0)
    tried = [now_s for now_s in range(20) if backoff.due(float(now_s))]
    assert tried == [0, 1, 3, 7, 11, 15, 19]
    backoff.succeeded()
    assert backoff.due(100.0) and backoff.due(101.0)
