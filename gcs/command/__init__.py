"""What an operator may command, through MAVSDK: the UAV and its camera, never a ground vehicle.

Nothing here is imported while the station only listens.
"""

from __future__ import annotations

from gcs.command.desk import CommandDesk
from gcs.command.jobs import Rules
from gcs.command.orders import ORDERS, Order
from gcs.command.wire import Place

__all__ = ["ORDERS", "CommandDesk", "Order", "Place", "Rules"]
