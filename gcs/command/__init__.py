"""Orders that an operator may give, through MAVSDK: the UAV and its camera, never a ground vehicle.

Nothing here is imported while the station only listens.
"""

from __future__ import annotations

from gcs.command.executor import CommandParams
from gcs.command.mav_cmd import GeoPoint
from gcs.command.orders import ORDERS, Order
from gcs.command.service import CommandService

__all__ = ["ORDERS", "CommandParams", "CommandService", "GeoPoint", "Order"]
