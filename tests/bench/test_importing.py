"""A flight loses no names by positions that its subtitles round to 11 m."""

import pytest

from bench.importing.__main__ import rows_of

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", ["straight", "winding"])
def test_four_decimals_cost_no_names(kind):
    ((*_, right, wrong, sure_s, refused),) = rows_of(kind, 102, 15.0, ("four decimals",))
    assert right > 0.98
    assert (wrong, sure_s, refused) == (0.0, 0.0, 0.0)


def test_coarse_positions_do_not_name_strangers():
    ((*_, wrong, sure_s, refused),) = rows_of("hover", 501, 15.0, ("four decimals",), others=True)
    assert (wrong, sure_s, refused) == (0.0, 0.0, 0.0)
