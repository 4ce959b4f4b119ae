"""Orders that an operator may give, in words. The table is all of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """One thing to order of the UAV."""

    key: str
    words: str
    """Name of the order, with ``{uav}`` and, when it is about a ground vehicle, ``{ugv}``."""
    about: Literal["ugv", "uav"]
    """Target that it needs: a ground vehicle, or the UAV alone."""
    job: Literal["camera", "flight", ""] = ""
    """Job that it takes over from an order before; empty: from none."""

    def words_with(self, uav: str, ugv: str) -> str:
        """Return the order in words, with names."""
        return self.words.replace("{uav}", uav).replace("{ugv}", ugv)


def _of_ugv(key: str, words: str, job: Literal["camera", "flight"]) -> Order:
    return Order(key=key, words=words, about="ugv", job=job)


def _of_uav(key: str, words: str, job: Literal["camera", "flight", ""] = "") -> Order:
    return Order(key=key, words=words, about="uav", job=job)


ORDERS: Final = (
    _of_ugv("point", "Point the camera at {ugv}", "camera"),
    _of_ugv("track", "Point the camera at {ugv} by the positions received here", "camera"),
    _of_ugv("above", "Fly {uav} above {ugv}, at its present height", "flight"),
    _of_ugv("follow", "Let {uav} follow {ugv}, at its present height", "flight"),
    _of_ugv("orbit", "Let {uav} circle around {ugv}, at its present height", "flight"),
    _of_uav("hold", "Let {uav} stop and hold its position", "flight"),
    _of_uav("return", "Let {uav} return to launch", "flight"),
    _of_uav("unpoint", "Stop pointing the camera of {uav}", "camera"),
    _of_uav("neutral", "Turn the gimbal of {uav} to neutral", "camera"),
    _of_uav("take", "Take control of the gimbal of {uav}"),
    _of_uav("release", "Give up control of the gimbal of {uav}"),
    _of_uav("photo", "Take a photo with the camera of {uav}"),
    _of_uav("record", "Start recording on board of {uav}"),
    _of_uav("record_stop", "Stop recording on board of {uav}"),
)


def orders_about(*, ugv: bool) -> Sequence[Order]:
    """Orders that make sense: about a ground vehicle when one is selected, and about the UAV always."""
    return [order for order in ORDERS if ugv or order.about == "uav"]


_BY_KEY: Final = {order.key: order for order in ORDERS}


def order_of(key: str) -> Order:
    """The order with a key; KeyError for none."""
    return _BY_KEY[key]
