"""Statements of an operator about tracks, as evidence that a track begins with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import PairState
from assoc.history import TrackHistory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NONE_OF_OURS = -1
"""Value in place of a vehicle's index for none of ours."""


class StatedTracks:
    """The statements that hold: the index of the vehicle, or ``NONE_OF_OURS``, by track id.

    Args:
        nats: What a statement counts.
        nats_after_gap: What it still counts once the track was lost, and a tracker may have gone on with another one.
    """

    def __init__(self, nats: float, nats_after_gap: float) -> None:
        self._nats, self._nats_after_gap = nats, nats_after_gap
        self._vehicle: dict[int, int] = {}

    def set(self, track_id: int, vehicle: int) -> None:
        """State what a track is."""
        self._vehicle[track_id] = vehicle

    def withdraw(self, track_id: int) -> bool:
        """State nothing of a track any more; whether anything was."""
        return self._vehicle.pop(track_id, None) is not None

    def clear(self) -> None:
        """State nothing of any track any more."""
        self._vehicle.clear()

    def among(self, track_id: IntArray) -> BoolArray:
        """(m,) of which tracks anything is stated."""
        return np.isin(track_id, list(self._vehicle))

    def strangers_among(self, track_id: IntArray) -> BoolArray:
        """(m,) of which tracks it is stated that they are none of ours."""
        return np.array([self._vehicle.get(key) == NONE_OF_OURS for key in track_id.tolist()], np.bool_)

    def scores(self, track_id: IntArray, n: int) -> FloatArray:
        """(m, n) nats that the statements count for, or below 0 against, each vehicle."""
        score = np.zeros((len(track_id), n))
        for row, key in enumerate(track_id.tolist()):
            vehicle = self._vehicle.get(key)
            if vehicle == NONE_OF_OURS:
                score[row] = -self._nats
            elif vehicle is not None:
                score[row, vehicle] = self._nats
        return score

    def with_statements(
        self, state: PairState, columns: IntArray, history: TrackHistory, *, after_gap: BoolArray
    ) -> PairState:
        """The state in which the statements on the tracks of some columns count, once more.

        Args:
            state: Until now.
            columns: Of the tracks.
            history: Has which tracks they are.
            after_gap: (k,) tracks that were lost since the statement was made.
        """
        stated = [(column, self._vehicle.get(int(history.track_id[column]))) for column in columns.tolist()]
        if all(vehicle is None for _, vehicle in stated):
            return state
        score, seen = state.score.copy(), state.seen.copy()
        for (column, vehicle), lost in zip(stated, after_gap.tolist(), strict=True):
            if vehicle is not None:
                nats = self._nats_after_gap if lost else self._nats
                about = slice(None) if vehicle == NONE_OF_OURS else slice(vehicle, vehicle + 1)
                score[column, about] = np.where(seen[column, about], score[column, about], 0.0)
                score[column, about] += -nats if vehicle == NONE_OF_OURS else nats
                seen[column, about] = True
        return replace(state, score=score, seen=seen)
