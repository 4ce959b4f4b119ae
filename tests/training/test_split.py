"""What is kept apart shows other places than what is trained on, as far as names tell."""

from __future__ import annotations

import numpy as np
import pytest

from training.split import split
from vision.errors import LabelError
from vision.evaluation import LabelledImage, Truth


def images_of(*names, objects=5):
    truth = Truth(
        boxes=np.ones((objects, 5)),
        heading=np.full(objects, np.nan),
        name=np.full(objects, "car"),
        counts=np.full(objects, True),
        hidden=np.full(objects, -1),
    )
    return [LabelledImage(name=name, read=lambda: np.zeros((8, 8, 3), np.uint8), truth=truth) for name in names]


def kept_names(*names, share=0.2, seed=0):
    parts = split(images_of(*names), share, seed)
    assert sorted(i.name for i in (*parts.rest, *parts.kept)) == sorted(names)
    return {i.name for i in parts.kept}, parts.how


def test_folders_for_validation_are_kept_apart():
    kept, how = kept_names("images/train/a1.jpg", "images/val/b1.jpg", "images/Test/c.jpg", "images/train/a2.jpg")
    assert kept == {"images/val/b1.jpg", "images/Test/c.jpg"}
    assert "validation" in how


@pytest.mark.parametrize("place", ["flight{}/{:03}.jpg", "flight_{}-{:03}.jpg"])
def test_folders_and_sequences_stay_whole(place):
    names = [place.format("abcdef"[f], k) for f in range(6) for k in range(4)]
    for seed in range(5):
        kept, how = kept_names(*names, seed=seed)
        flights = {name[: place.index("{}") + 1] for name in kept}
        assert len(kept) == 4 * len(flights)
        assert 1 <= len(flights) <= 2
        assert "whole" in how


def test_one_film_is_split_in_order_of_time_and_this_is_told():
    names = [f"{k:05}.jpg" for k in range(20)]
    kept, how = kept_names(*names)
    assert kept == set(names[16:])
    assert "neighbours" in how


def test_one_large_and_one_tiny_sequence_are_no_split():
    names = [f"a{k:02}.jpg" for k in range(40)] + ["b1.jpg"]
    kept, how = kept_names(*names)
    assert len(kept) == 8
    assert "neighbours" in how


def test_unrelated_names_are_each_their_own():
    kept, _ = kept_names(*(f"{letter}{letter}.jpg" for letter in "abcdefghijklmnopqrst"))
    assert 2 <= len(kept) <= 6


def test_the_seed_decides():
    names = [f"place{letter}/1.jpg" for letter in "abcdefghij"]
    assert kept_names(*names, seed=1) == kept_names(*names, seed=1)
    assert len({frozenset(kept_names(*names, seed=seed)[0]) for seed in range(6)}) > 1


@pytest.mark.parametrize("names", [("a.jpg",), ("val/a.jpg", "test/b.jpg")])
def test_what_cannot_be_split_is_told(names):
    with pytest.raises(LabelError, match="train on"):
        split(images_of(*names), 0.2, 0)
