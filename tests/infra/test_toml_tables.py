"""Tables into dataclasses: what the tests of missions and scenarios do not show."""

from dataclasses import dataclass
from typing import Annotated

import pytest
from msgspec import Meta

from infra.toml_tables import build, check_limits


@dataclass(frozen=True, kw_only=True)
class Wheel:
    bolts: Annotated[int, Meta(ge=3, le=9)] = 4


@dataclass(frozen=True, kw_only=True)
class Cart:
    length_m: Annotated[float, Meta(ge=0.5, le=9.0)]
    front: Wheel = Wheel()
    wheels: tuple[Wheel, ...] = ()

    def __post_init__(self):
        if len(self.wheels) == 1:
            raise ValueError("falls over")


def test_a_whole_number_may_have_a_point():
    assert build(Cart, {"length_m": 2, "front": {"bolts": 5.0}}, "c") == Cart(length_m=2.0, front=Wheel(bolts=5))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ([], "c must be a table of keys and values"),
        ({}, "c: length_m is missing"),
        ({"length_m": 1, "front": {"bolts": 2}}, "c: [front]: bolts is 2; it must lie between 3 and 9"),
        (
            {"length_m": 1, "wheels": [{"bolt": 5}]},
            "c: [[wheels]] number 1: unknown key 'bolt'; did you mean bolts?",
        ),
        (
            {"length_m": 1, "wheels": [{"bolts": "x"}]},
            "c: [[wheels]] number 1: bolts is 'x'; a whole number is needed",
        ),
        ({"length_m": 1, "wheels": [{}]}, "c: falls over"),
        ({"length_m": 1, "wheels": [3, 4]}, "c: [[wheels]] number 1 must be a table of keys and values"),
    ],
)
def test_says_where_what_and_what_is_needed(table, message):
    with pytest.raises(ValueError) as error:
        build(Cart, table, "c")
    assert str(error.value) == message


def test_limits_hold_for_what_was_not_read_from_a_file():
    check_limits(Cart(length_m=1.0), "cart")
    with pytest.raises(ValueError, match=r"cart: \[front\]: bolts is 99; it must lie between 3 and 9"):
        check_limits(Cart(length_m=1.0, front=Wheel(bolts=99)), "cart")
