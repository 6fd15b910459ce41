"""A graph of smears that agree up to sign: who is near whom, which edges are certain, what they connect.

Two smears agree when their displacements agree up to sign. An edge is supported when the smears around
both agree with both; chance agreements (outliers) and the borders of layers lack that. Components come from
the graph's double cover, in which every node is there as it is and flipped: the two copies meet exactly where
the signs around a cycle contradict each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import TINY, Array

Labels = NDArray[np.int_]
CELLS, SLOTS = 4, 16  # a point's name among its neighbours: one of 4 x 4 cells, one of 16 places in the cell
WORD = 32  # bits that a float64 sum of powers of two holds
POWERS: Array = np.ldexp(1.0, np.arange(CELLS * CELLS * SLOTS) % WORD)
PROBES = 128  # points at which the density is measured


def near_pairs(points: Array, neighbours: int) -> tuple[Labels, float]:
    """Return the pairs (2, E) of points nearer than a distance, and that distance.

    Within it a typical point has ``neighbours`` others. Where the density varies a lot, every point's nearest
    ``neighbours`` others are taken instead, so that E stays at most N neighbours.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    k = min(neighbours + 1, len(points))
    distance = tree.query(points[:: max(len(points) // PROBES, 1)], k)[0][:, -1]
    radius = float(np.median(distance))
    if np.quantile(distance, 0.1) > 0.4 * radius:
        pairs = tree.query_pairs(radius, output_type="ndarray")
        return np.ascontiguousarray(pairs.T, dtype=int), radius
    nearest = tree.query(points, k)[1][:, 1:]
    own = np.repeat(np.arange(len(points)), k - 1)
    both = np.stack([np.minimum(own, nearest.ravel()), np.maximum(own, nearest.ravel())])
    unique = np.unique(both[0] * len(points) + both[1])
    return np.stack(np.divmod(unique, len(points))), radius


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """Pairs (i, j) of smears that agree up to sign; all of shape (E,).

    ``sign`` +1 or -1 is that of the dot product, ``difference`` |d_i -+ d_j| over the rms length.
    """

    i: Labels
    j: Labels
    sign: Array
    difference: Array

    @classmethod
    def between(cls, displacement: Array, pairs: Labels, max_difference: float) -> Edges:
        """Return the edges of pairs whose displacements agree up to sign."""
        i, j = pairs
        x, y = displacement.T
        squared = x * x + y * y
        dot = x[i] * x[j] + y[i] * y[j]
        total = squared[i] + squared[j]
        relative = 2 * np.maximum(total - 2 * np.abs(dot), 0.0) / np.maximum(total, TINY)  # squared
        kept = np.flatnonzero((relative < max_difference**2) & (total > 0))
        return cls(
            i=i[kept], j=j[kept], sign=np.where(dot[kept] < 0, -1.0, 1.0), difference=np.sqrt(relative[kept])
        )

    def only(self, kept: NDArray[np.bool_]) -> Edges:
        """Return a part of the edges."""
        return Edges(i=self.i[kept], j=self.j[kept], sign=self.sign[kept], difference=self.difference[kept])


def support(points: Array, radius: float, near: Labels, edges: Edges) -> tuple[Labels, Labels]:
    """Return, per edge, how many points near both ends agree with both, and how many with either.

    ``points`` (N, 2), ``near`` (2, E) all pairs nearer than ``radius``, ``edges`` those that agree.
    """
    bit = _local_bits(points, radius)
    agree, around = _neighbour_bits(bit, edges.i, edges.j), _neighbour_bits(bit, *near)
    both, either = np.zeros(len(edges.i), int), np.zeros(len(edges.i), int)
    for agrees, near_by in zip(agree, around, strict=True):
        one, other = agrees[edges.i], agrees[edges.j]
        both += np.bitwise_count(one & other)
        either += np.bitwise_count((one | other) & near_by[edges.i] & near_by[edges.j])
    return both, either


def _local_bits(points: Array, radius: float) -> Labels:
    """Return one of 256 numbers for each point, different from those of nearly all points near it.

    Points share a number if they are four cells of the given side apart, or crowd by more than 16 in a cell.
    """
    col, row = np.floor((points - points.min(axis=0)) / max(radius, 1e-9)).astype(int).T
    cell = row * (int(col.max()) + 1) + col
    order = np.argsort(cell, kind="stable")
    place = np.empty(len(points), int)
    place[order] = np.arange(len(points)) - np.searchsorted(cell[order], cell[order])
    number: Labels = (row % CELLS * CELLS + col % CELLS) * SLOTS + place % SLOTS
    return number


def _neighbour_bits(bit: Labels, i: Labels, j: Labels) -> NDArray[np.uint64]:
    """Return each node's neighbours as bits, (2, N); two neighbours with one number are miscounted."""
    count, halves = len(bit), CELLS * CELLS * SLOTS // WORD
    own, name = np.concatenate([i, j]), np.concatenate([bit[j], bit[i]])
    total = np.bincount(name // WORD * count + own, weights=POWERS[name], minlength=count * halves)
    low, high = (
        np.minimum(total, 2.0**WORD - 1).astype(np.uint64).reshape(halves // 2, 2, count).swapaxes(0, 1)
    )
    return low | high << np.uint64(WORD)


def connected(i: Labels, j: Labels, count: int) -> Labels:
    """Return labels (count,) of the connected components of the undirected graph of edges (i, j)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pair = i.astype(np.int32), j.astype(np.int32)
    graph = coo_array((np.ones(len(i)), pair), shape=(count, count))
    graph.has_canonical_format = True  # nothing to sort and sum: an edge that is there twice does no harm
    label: Labels = connected_components(graph.tocsr(), directed=False)[1]
    return label


def double_cover(edges: Edges, count: int) -> tuple[Labels, Labels]:
    """Return components of the double cover: labels (N,) of every node as it is, and of it flipped.

    The two are equal exactly where a cycle's signs contradict each other.
    """
    flip = np.where(edges.sign > 0, 0, count)
    own, other = np.concatenate([edges.i, edges.i + count]), np.concatenate([flip, count - flip])
    label = connected(own, np.tile(edges.j, 2) + other, 2 * count)
    return label[:count], label[count:]


def consistent_signs(edge_sets: Iterable[Edges], count: int) -> tuple[Labels, Array]:
    """Return labels 0, 1, ... and signs by the first edges in which a node's component is consistent.

    ``edge_sets`` are sets of edges, each part of the one before, read as far as needed. A node that no set
    decides is alone.
    """
    label, sign, decided = np.arange(count), np.ones(count), np.zeros(count, bool)
    for level, edges in enumerate(edge_sets, start=1):
        kept, flipped = double_cover(edges, count)
        new = ~decided & (kept != flipped)
        label[new] = 2 * count * level + np.minimum(kept, flipped)[new]
        sign[new] = np.where(kept < flipped, 1.0, -1.0)[new]
        decided |= new
        if decided.all():
            break
    return np.unique(label, return_inverse=True)[1], sign
