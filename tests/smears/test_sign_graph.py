"""The graph of agreeing smears against brute force."""

import numpy as np
import pytest

from blur2view.arrays import Array
from blur2view.smears.sign_graph import Edges, consistent_signs, double_cover, near_pairs, support


def field(seed: int, count: int = 400) -> tuple[Array, Array]:
    """Give points and displacements, half of them alike up to sign."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (count, 2)) * [640, 480]
    d = np.array([10.0, 3.0]) + rng.normal(0, 1, (count, 2))
    d[rng.random(count) < 0.5] *= -1
    random = rng.random(count) < 0.5
    d[random] = rng.normal(0, 10, (int(random.sum()), 2))
    return points, d


def edges_of(*triples: tuple[int, int, float]) -> Edges:
    i, j, sign = np.array(triples, float).reshape(-1, 3).T
    return Edges(i=i.astype(int), j=j.astype(int), sign=sign, difference=np.zeros(len(i)))


def test_near_pairs_are_those_within_the_distance() -> None:
    points, _ = field(0)
    pairs, radius = near_pairs(points, 16)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = np.argwhere(np.triu(distance <= radius, 1))
    assert {tuple(pair) for pair in pairs.T} == {tuple(pair) for pair in expected}
    assert 10 < 2 * pairs.shape[1] / len(points) < 20


def test_edges_agree_up_to_sign() -> None:
    points, d = field(1)
    near, _ = near_pairs(points, 16)
    edges = Edges.between(d, near, 0.4)
    kept = set(zip(edges.i, edges.j, strict=True))
    for i, j in near.T:
        least = min(np.linalg.norm(d[i] - d[j]), np.linalg.norm(d[i] + d[j]))
        rms = np.sqrt((d[i] @ d[i] + d[j] @ d[j]) / 2)
        assert ((i, j) in kept) == (least < 0.4 * rms)
    aligned = np.linalg.norm(d[edges.i] - edges.sign[:, None] * d[edges.j], axis=1)
    assert (aligned <= np.linalg.norm(d[edges.i] + edges.sign[:, None] * d[edges.j], axis=1)).all()


def test_support_counts_common_neighbours() -> None:
    points, d = field(2)
    near, radius = near_pairs(points, 16)
    edges = Edges.between(d, near, 0.4)
    around, agree = np.zeros((2, 400, 400), bool)
    for matrix, i, j in ((around, *near), (agree, edges.i, edges.j)):
        matrix[i, j] = matrix[j, i] = True
    both, either = support(points, radius, near, edges)
    near_both = around[edges.i] & around[edges.j]
    assert (both == (agree[edges.i] & agree[edges.j]).sum(axis=1)).mean() > 0.98
    expected = (near_both & (agree[edges.i] | agree[edges.j])).sum(axis=1)
    assert (either == expected).mean() > 0.95


def test_double_cover_meets_where_signs_contradict() -> None:
    consistent = edges_of((0, 1, 1), (1, 2, -1), (0, 2, -1))
    kept, flipped = double_cover(consistent, 4)
    assert kept[0] == kept[1] == flipped[2]
    assert (kept != flipped).all()
    kept, flipped = double_cover(edges_of((0, 1, 1), (1, 2, -1), (0, 2, 1)), 4)
    assert (kept[:3] == flipped[:3]).all()
    assert kept[3] != flipped[3]


@pytest.mark.parametrize("seed", range(5))
def test_balanced_recovers_the_signs_of_a_consistent_graph(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.choice([-1.0, 1.0], 60)
    i, j = rng.integers(0, 60, (2, 80))
    i, j = np.minimum(i, j)[i != j], np.maximum(i, j)[i != j]
    edges = Edges(i=i, j=j, sign=truth[i] * truth[j], difference=np.zeros(len(i)))
    label, sign = consistent_signs([edges], 60)
    assert (label[i] == label[j]).all()
    assert (np.abs(np.bincount(label, weights=sign * truth)) == np.bincount(label)).all()


def test_a_contradiction_falls_to_the_next_rung_alone() -> None:
    bad = (0, 1, 1.0), (1, 2, -1.0), (0, 2, 1.0)
    label, sign = consistent_signs([edges_of(*bad, (3, 4, -1)), edges_of((0, 1, 1), (3, 4, -1))], 5)
    assert label[0] == label[1] != label[2]
    assert label[3] == label[4] and sign[3] == -sign[4]
    assert len(np.unique(consistent_signs([edges_of(*bad)], 3)[0])) == 3
