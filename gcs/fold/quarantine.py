"""Names that are not given: of vehicles whose system id several senders use, or whose positions the video contradicts;
and names of little confidence."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from assoc.identification.doubts import AnswerDoubt
from assoc.records import Identities
from mavlink.state import FleetState

_OF_THE_NAME = ("confidence", "residual_m", "position_age_s", "projection", "topology", "fused")
_MAX_DOUBTED = 0.75
"""Confidence in a name whose vehicle doubts its own position: it rests on what was seen before."""


def limit_doubted(identities: Identities | None, state: FleetState, threshold: float) -> Identities | None:
    """Identities in which names of vehicles that doubt their own positions are of little confidence.

    What is taken from such a name goes to "none of ours".

    Args:
        identities: as found.
        state: who doubts.
        threshold: least confidence of a name that is given.
    """
    doubtful = [vehicle.system_id for vehicle in state.vehicles[1:] if vehicle.doubted_for]
    if identities is None or not doubtful:
        return identities
    limit = np.where(np.isin(identities.system_id, doubtful), max(_MAX_DOUBTED, threshold), 1.0)
    confidence = np.minimum(identities.confidence, limit)
    over, rows = identities.confidence - confidence, identities.candidates
    own = rows.system_id == identities.system_id[:, None]
    limited = replace(
        rows,
        confidence=np.where(own, confidence[:, None], rows.confidence),
        none_of_ours=rows.none_of_ours + over,
    )
    doubt = np.where(over > 0.0, AnswerDoubt.OWN_WORD, identities.doubt)
    return replace(identities, confidence=confidence, candidates=limited, doubt=doubt)


def withhold_names(
    identities: Identities | None, state: FleetState, contradicted: Collection[int] = (), left: Collection[int] = ()
) -> Identities | None:
    """Identities without contested and contradicted names; without any while it is the UAV's own id that is contested.

    Evidence from before a second sender came may be from either of the two.
    """
    kept_back = [*state.contested, *contradicted]
    if identities is None or not kept_back:
        return identities
    all_in_doubt = state.vehicles[0].contested
    refused = identities.system_id != 0 if all_in_doubt else np.isin(identities.system_id, kept_back)
    of_liars = np.isin(identities.track_id, list(left)) & (identities.system_id == 0)
    lies = np.isin(identities.system_id, list(contradicted)) | of_liars
    refused |= of_liars
    unknown: dict[str, Any] = {name: np.where(refused, np.nan, getattr(identities, name)) for name in _OF_THE_NAME}
    rival = all_in_doubt | np.isin(identities.runner_up, kept_back)
    return replace(
        identities,
        system_id=np.where(refused, 0, identities.system_id),
        runner_up=np.where(rival, 0, identities.runner_up),
        runner_up_confidence=np.where(rival, np.nan, identities.runner_up_confidence),
        # nobody knows, which is no stranger either
        candidates=replace(
            identities.candidates, none_of_ours=np.where(refused, np.nan, identities.candidates.none_of_ours)
        ),
        doubt=np.where(refused, np.where(lies, AnswerDoubt.CONTRADICTED, AnswerDoubt.CONTESTED), identities.doubt),
        **unknown,
    )
