"""What is a number in a table: what every reader of text takes for one."""

import math

import pytest

from infra.text_numbers import number, number_or_nan


@pytest.mark.parametrize(
    ("text", "value"),
    [("0", 0.0), (" -1.5 ", -1.5), ("+3", 3.0), (".5", 0.5), ("5.", 5.0), ("1e-3", 0.001)],
)
def test_a_number(text, value):
    assert number(text) == number_or_nan(text) == value


@pytest.mark.parametrize(
    "text", ["", " ", "x", "1_0", "٣", "４７", "nan", "-NaN", "inf", "infinity", "1e999", "0x10", "1,5", "1" * 40]
)
def test_what_is_none(text):
    assert math.isnan(number_or_nan(text))
    with pytest.raises(ValueError, match="is no number"):
        number(text)
