from __future__ import annotations

import numpy as np
import pytest

from training.fronts.cluster import ends_apart, paired_kmeans


def looks(n=300, kinds=3, m=64, noise=0.3, seed=0):
    """Features of crops of several kinds of vehicle: what shows the front is small beside colour and ground."""
    rng = np.random.default_rng(seed)
    direction = np.linalg.qr(rng.normal(size=(m, kinds)))[0].T * 3.0
    kind = rng.choice(kinds, size=n, p=[0.5, 0.3, 0.2])
    right = rng.random(n) < 0.5
    both = 20.0 * rng.normal(size=(n, m))
    front = direction[kind] * np.where(right, 1.0, -1.0)[:, None]
    ahead = both + front + noise * rng.normal(size=(n, m))
    return ahead, both - front + noise * rng.normal(size=(n, m)), kind, right


def test_crops_of_a_cluster_face_one_way_whatever_their_colour():
    ahead, turned, kind, right = looks()
    found = paired_kmeans(ends_apart(ahead, turned), 3, np.random.default_rng(0))
    for number in range(3):
        members = found.number == number
        assert len(set(kind[members])) == 1
        shown_right = right[members] ^ found.turned[members]
        assert shown_right.all() or not shown_right.any()
    # the largest comes first
    assert np.bincount(found.number).tolist() == sorted(np.bincount(kind), reverse=True)
    assert found.sure.min() > 0.6


def test_a_crop_and_its_turned_copy_change_places_together():
    ahead, turned, _, _ = looks()
    swap = np.arange(len(ahead)) % 2 == 0
    a, b = np.where(swap[:, None], turned, ahead), np.where(swap[:, None], ahead, turned)
    before = paired_kmeans(ends_apart(ahead, turned), 3, np.random.default_rng(0))
    after = paired_kmeans(ends_apart(a, b), 3, np.random.default_rng(0))
    np.testing.assert_array_equal(before.number, after.number)
    flipped = after.turned ^ before.turned ^ swap
    for number in range(3):  # a whole cluster may face the other way: which way is never known
        assert len(set(flipped[before.number == number])) == 1


def test_the_same_seed_gives_the_same_clusters():
    d = ends_apart(*looks(noise=3.0)[:2])
    a, b = (paired_kmeans(d, 5, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(a.number, b.number)
    np.testing.assert_array_equal(a.turned, b.turned)


def test_what_looks_alike_from_both_ends_is_unsure():
    ahead, turned, _, _ = looks(n=50)
    turned[7] = ahead[7]
    found = paired_kmeans(ends_apart(ahead, turned), 2, np.random.default_rng(0))
    assert found.sure[7] == 0.0
    assert np.isfinite(found.sure).all()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_fewer_crops_than_clusters(n):
    ahead, turned, _, _ = looks(n=n)
    found = paired_kmeans(ends_apart(ahead, turned), 8, np.random.default_rng(0))
    assert found.number.max() < n
    assert len(found.turned) == n
