"""Names that are not given: of vehicles whose system id several senders use."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from assoc.identifier import Identities
from mavlink.fleet import FleetState

__all__ = ["quarantined"]

_OF_THE_NAME = ("confidence", "residual_m", "position_age_s", "projection", "topology", "fused")


def quarantined(identities: Identities | None, state: FleetState) -> Identities | None:
    """Identities without the contested names; without any while it is the UAV's own id that is contested.

    Evidence that was heard before the second sender came says nothing of which of the two it came from.
    """
    contested = [vehicle.system_id for vehicle in state.vehicles if vehicle.contested]
    if identities is None or not contested:
        return identities
    all_in_doubt = state.vehicles[0].contested
    refused = identities.system_id != 0 if all_in_doubt else np.isin(identities.system_id, contested)
    unknown: dict[str, Any] = {name: np.where(refused, np.nan, getattr(identities, name)) for name in _OF_THE_NAME}
    rival = all_in_doubt | np.isin(identities.runner_up, contested)
    return replace(
        identities,
        system_id=np.where(refused, 0, identities.system_id),
        runner_up=np.where(rival, 0, identities.runner_up),
        runner_up_confidence=np.where(rival, np.nan, identities.runner_up_confidence),
        **unknown,
    )
