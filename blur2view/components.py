"""Sign components: groups of smears whose relative order is certain, so that each has one unknown sign.

Smears of one surface that are near each other have nearly the same displacement, up to the sign nobody
knows. An edge joins two near smears whose displacements agree up to sign; it is certain where the smears
around both agree with both, which chance agreements (outliers) and the borders of layers lack. Components of
certain edges then merge where they touch and most pairs across agree. A component in which the signs
contradict each other (around a cycle) falls back to fewer edges. Near and far layers may move oppositely, so
components are only as large as the field is smooth.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.epipolar import Array
from blur2view.matches import SmearMatches

Labels = NDArray[np.int_]
CELLS, SLOTS = 4, 8  # a smear's name among its neighbours: one of 4 x 4 cells, one of 8 places in the cell
WORD = 32  # bits that a float64 sum of powers of two holds
POWERS: Array = np.ldexp(1.0, np.arange(CELLS * CELLS * SLOTS) % WORD)
BLOCK = 4  # side, in distances that count as near, of the blocks that a contradictory component falls into
PROBES = 128  # points at which the density is measured


@dataclass(frozen=True, kw_only=True)
class ComponentOptions:
    """When the relative order of two smears counts as certain.

    ``neighbours`` the mean number of smears within the distance that counts as near; ``max_difference`` the
    greatest |d_i -+ d_j| over the root mean square length that agrees, tightened to ``usual`` times the
    median of the certain edges but not below ``floor``; ``min_common`` near smears that must agree with both
    ends of a certain edge, and ``min_common_share`` their least share of those that agree with one;
    ``min_merge`` the least number of agreeing pairs across that merge two components, and
    ``min_merge_share`` their least share of all near pairs across.
    """

    neighbours: int = 16
    max_difference: float = 0.4
    usual: float = 3.0
    floor: float = 0.2
    min_common: int = 2
    min_common_share: float = 0.5
    min_merge: int = 2
    min_merge_share: float = 0.5

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        if self.neighbours < 1 or self.min_common < 0 or self.min_merge < 1:
            raise ValueError(f"need neighbours, min_merge >= 1, min_common >= 0, got {self}")
        if not 0 <= self.floor <= self.max_difference < 2 or not self.usual > 0:
            raise ValueError(f"need 0 <= floor <= max_difference < 2 and usual > 0, got {self}")
        if not 0 <= self.min_common_share <= 1:
            raise ValueError(f"min_common_share must be in [0, 1], got {self.min_common_share}")
        if not 0 < self.min_merge_share <= 1:
            raise ValueError(f"min_merge_share must be in (0, 1], got {self.min_merge_share}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SignComponents:
    """Smears grouped so that each group has one unknown sign.

    Parameters
    ----------
    label : ndarray of int, shape (N,)
        The component of every smear, 0 to count - 1, largest first.
    sign : ndarray of shape (N,)
        +1 or -1: displacements times sign are alike oriented inside a component.
    """

    label: Labels
    sign: Array

    def __post_init__(self) -> None:
        """Check shapes and values."""
        if self.label.ndim != 1 or self.label.shape != self.sign.shape:
            raise ValueError(f"expected label and sign (N,), got {self.label.shape} and {self.sign.shape}")
        if not (np.abs(self.sign) == 1).all() or (len(self.label) and self.label.min() < 0):
            raise ValueError("labels must not be negative, signs must be +1 or -1")

    def __len__(self) -> int:
        """Give the number of smears."""
        return len(self.label)

    @property
    def count(self) -> int:
        """Number of components, singletons included."""
        return int(self.label.max()) + 1 if len(self.label) else 0

    @property
    def sizes(self) -> Labels:
        """Smears of every component, (count,)."""
        return np.bincount(self.label)

    def touched(self, samples: NDArray[np.int_]) -> Labels:
        """Count the components (B,) that index sets (B, m) touch."""
        ordered = np.sort(self.label[samples], axis=1)
        touched: Labels = 1 + (np.diff(ordered, axis=1) != 0).sum(axis=1)
        return touched

    def subset(self, index: NDArray[np.int_] | NDArray[np.bool_]) -> SignComponents:
        """Only the smears of an index or mask, relabelled."""
        return _relabelled(self.label[index], self.sign[index])


def no_components(count: int) -> SignComponents:
    """Give every smear a component of its own: no order is known of any other."""
    return SignComponents(label=np.arange(count), sign=np.ones(count))


def sign_components(matches: SmearMatches, options: ComponentOptions | None = None) -> SignComponents:
    """Group smears whose relative order is certain.

    Parameters
    ----------
    matches : SmearMatches
        Scattered anywhere; their sigma is not used.
    options : ComponentOptions, optional

    Returns
    -------
    SignComponents
        Outliers and smears without like neighbours are mostly singletons. Deterministic.
    """
    options = options or ComponentOptions()
    if len(matches) < 2:
        return no_components(len(matches))
    near, radius = near_pairs(matches.midpoint, options.neighbours)
    edges = _Edges.between(matches.displacement, near, options.max_difference)
    certain = edges.only(_supported(matches.midpoint, radius, near, edges, options))
    if len(certain.i):
        usual = options.usual * float(np.median(certain.difference))
        limit = float(np.clip(usual, options.floor, options.max_difference))
        certain, edges = certain.only(certain.difference < limit), edges.only(edges.difference < limit)
    halved = certain.only(certain.difference < 0.5 * options.max_difference)
    block = np.floor(matches.midpoint / max(BLOCK * radius, 1e-9)).astype(int)
    local = halved.only((block[halved.i] == block[halved.j]).all(axis=1))
    label, sign = _balanced([certain, halved, local], len(matches))
    joins = _joins(label, sign, near, edges, options)
    joined, flip = _balanced([joins], int(label.max()) + 1)
    return _relabelled(joined[label], sign * flip[label])


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplePatterns:
    """Sign patterns of samples that touch equally many components.

    ``index`` (b,) says which samples these are; ``signs`` (b, P, m) are their patterns as
    `seven_smears.solve_seven_smears` takes them, P = 2^(touched - 1), the first sign of each +1.
    """

    index: Labels
    signs: Array


def sample_patterns(components: SignComponents, drawn: Labels) -> list[SamplePatterns]:
    """Give the sign patterns that components leave for every sample, grouped by their number.

    Parameters
    ----------
    components : SignComponents
        `no_components` leaves all 2^(m - 1) patterns.
    drawn : ndarray of int, shape (B, m)
        Index sets.

    Returns
    -------
    list of SamplePatterns
        By growing number of patterns; every sample is in exactly one.

    Examples
    --------
    >>> for group in sample_patterns(components, drawn):
    ...     F, sample = solve_seven_smears(ends[drawn[group.index]], group.signs)
    ...     sample = group.index[sample]
    """
    label = components.label[drawn]  # (B, m)
    order = np.argsort(label, axis=1, kind="stable")
    ordered = np.take_along_axis(label, order, axis=1)
    step = np.concatenate([np.zeros((len(drawn), 1), int), np.diff(ordered, axis=1) != 0], axis=1)
    place = np.empty_like(label)  # which of the touched components, 0, 1, ...
    np.put_along_axis(place, order, np.cumsum(step, axis=1), axis=1)
    touched = place.max(axis=1, initial=0) + 1
    groups = []
    for number in np.unique(touched):
        index = np.flatnonzero(touched == number)
        free = np.array(list(itertools.product([1.0, -1.0], repeat=int(number) - 1)))  # (P, number - 1)
        table = np.concatenate([np.ones((len(free), 1)), free], axis=1)
        signs = np.swapaxes(table[:, place[index]], 0, 1) * components.sign[drawn[index]][:, None]
        groups.append(SamplePatterns(index=index, signs=signs * signs[:, :, :1]))
    return groups


def near_pairs(points: Array, neighbours: int) -> tuple[Labels, float]:
    """Give the pairs (2, E) of points nearer than a distance, and that distance.

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
class _Edges:
    """Pairs (i, j) of smears that agree up to sign, the sign and the relative difference."""

    i: Labels
    j: Labels
    sign: Array
    difference: Array

    @classmethod
    def between(cls, displacement: Array, pairs: Labels, max_difference: float) -> _Edges:
        """Keep the pairs whose displacements agree up to sign."""
        i, j = pairs
        x, y = displacement.T
        squared = x * x + y * y
        dot = x[i] * x[j] + y[i] * y[j]
        total = squared[i] + squared[j]
        # |d_i -+ d_j|^2 over the mean square length: to first order the relative difference
        relative = 2 * np.maximum(total - 2 * np.abs(dot), 0.0) / np.maximum(total, 1e-30)
        kept = np.flatnonzero((relative < max_difference**2) & (total > 0))
        return cls(
            i=i[kept], j=j[kept], sign=np.where(dot[kept] < 0, -1.0, 1.0), difference=np.sqrt(relative[kept])
        )

    def only(self, kept: NDArray[np.bool_]) -> _Edges:
        """Keep a part."""
        return _Edges(i=self.i[kept], j=self.j[kept], sign=self.sign[kept], difference=self.difference[kept])


def _supported(
    points: Array, radius: float, near: Labels, edges: _Edges, options: ComponentOptions
) -> NDArray[np.bool_]:
    """Whether enough of the smears near both ends of an edge agree with both."""
    bit = _local_bits(points, radius)
    agree, around = _neighbour_bits(bit, edges.i, edges.j), _neighbour_bits(bit, *near)
    both, either = np.zeros(len(edges.i), int), np.zeros(len(edges.i), int)
    for agrees, near_by in zip(agree, around, strict=True):
        one, other = agrees[edges.i], agrees[edges.j]
        both += np.bitwise_count(one & other)
        either += np.bitwise_count((one | other) & near_by[edges.i] & near_by[edges.j])
    supported: NDArray[np.bool_] = (both >= options.min_common) & (both >= options.min_common_share * either)
    return supported


def _local_bits(points: Array, radius: float) -> Labels:
    """Give each point one of 128 numbers, different from those of nearly all points near it.

    Points share a number if they are four cells of the given side apart, or crowd by more than 8 in a cell.
    """
    col, row = np.floor((points - points.min(axis=0)) / max(radius, 1e-9)).astype(int).T
    cell = row * (int(col.max()) + 1) + col
    order = np.argsort(cell, kind="stable")
    place = np.empty(len(points), int)
    place[order] = np.arange(len(points)) - np.searchsorted(cell[order], cell[order])
    number: Labels = (row % CELLS * CELLS + col % CELLS) * SLOTS + place % SLOTS
    return number


def _neighbour_bits(bit: Labels, i: Labels, j: Labels) -> NDArray[np.uint64]:
    """Give each node's neighbours as bits, (2, N); two neighbours with one number are miscounted."""
    count, halves = len(bit), CELLS * CELLS * SLOTS // WORD
    own, name = np.concatenate([i, j]), np.concatenate([bit[j], bit[i]])
    total = np.bincount(name // WORD * count + own, weights=POWERS[name], minlength=count * halves)
    low, high = (
        np.minimum(total, 2.0**WORD - 1).astype(np.uint64).reshape(halves // 2, 2, count).swapaxes(0, 1)
    )
    joined: NDArray[np.uint64] = low | high << np.uint64(WORD)
    return joined


def _covers(edges: _Edges, count: int) -> tuple[Labels, Labels]:
    """Components of the double cover: labels (N,) of every node taken as it is, and of it taken flipped.

    The two are equal exactly where a cycle's signs contradict each other.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    flip = np.where(edges.sign > 0, 0, count)
    rows = np.concatenate([edges.i, edges.i + count]).astype(np.int32)
    cols = np.concatenate([edges.j + flip, edges.j + count - flip]).astype(np.int32)
    graph = coo_array((np.ones(len(rows)), (rows, cols)), shape=(2 * count, 2 * count))
    graph.has_canonical_format = True  # no edge is there twice: nothing to sort and sum
    label = connected_components(graph.tocsr(), directed=False)[1]
    return label[:count], label[count:]


def _balanced(rungs: list[_Edges], count: int) -> tuple[Labels, Array]:
    """Labels 0, 1, ... and signs from the first edges in which a node's component has no contradiction.

    What no set settles is alone.
    """
    label, sign, settled = np.arange(count), np.ones(count), np.zeros(count, bool)
    for rung, edges in enumerate(rungs, start=1):
        kept, flipped = _covers(edges, count)
        new = ~settled & (kept != flipped)
        label[new] = 2 * count * rung + np.minimum(kept, flipped)[new]
        sign[new] = np.where(kept < flipped, 1.0, -1.0)[new]
        settled |= new
        if settled.all():
            break
    return np.unique(label, return_inverse=True)[1], sign


def _joins(label: Labels, sign: Array, near: Labels, edges: _Edges, options: ComponentOptions) -> _Edges:
    """Edges between components that, where they touch, mostly agree in one relative sign."""
    count = int(label.max()) + 1
    one, other = label[edges.i], label[edges.j]
    across = one != other
    vote = (edges.sign * sign[edges.i] * sign[edges.j])[across]
    pairs, index = np.unique(_pair_key(one[across], other[across], count), return_inverse=True)
    net = np.bincount(index, weights=vote, minlength=len(pairs))
    touching = np.sort(_pair_key(label[near[0]], label[near[1]], count))
    total = np.searchsorted(touching, pairs, side="right") - np.searchsorted(touching, pairs)
    join = (np.abs(net) >= options.min_merge) & (np.abs(net) >= options.min_merge_share * total)
    i, j = np.divmod(pairs[join], count)
    return _Edges(i=i, j=j, sign=np.sign(net[join]), difference=np.zeros(len(i)))


def _pair_key(one: Labels, other: Labels, count: int) -> Labels:
    key: Labels = np.minimum(one, other) * count + np.maximum(one, other)
    return key


def _relabelled(label: Labels, sign: Array) -> SignComponents:
    """Name components 0, 1, ... by falling size."""
    _, index, sizes = np.unique(label, return_inverse=True, return_counts=True)
    rank = np.empty(len(sizes), int)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return SignComponents(label=rank[index], sign=sign)
