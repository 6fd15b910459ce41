"""Sign components: groups of smears whose relative order is certain, so that each has one unknown sign.

Smears of one surface that are near each other have nearly the same displacement, up to the unknown
sign. An edge joins two near smears whose displacements agree up to sign; it is certain where the smears
around both agree with both, which chance agreements (outliers) and the borders of layers lack. Components of
certain edges then merge where they touch and most pairs across agree. A component in which the signs
contradict each other (around a cycle) falls back to fewer edges. Near and far layers may move oppositely, so
components are only as large as the field is smooth.

Without them an estimate takes 0.86 of the time at an AUC@10 of 0.792, not 0.786 (619 synthetic instances), on
network smears 0.245, not 0.253 (70 scenes, six seeds); but one of eight exact scenes then ends in a local
minimum, at a rho of 0.0022, not 0.0004.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blur2view.arrays import Array
from blur2view.smears.matches import SmearMatches
from blur2view.smears.sign_graph import Edges, Labels, connected, consistent_signs, near_pairs, support

NEIGHBOURS = 16  # mean number of smears within the distance that counts as near
MAX_DIFFERENCE = 0.4  # greatest |d_i -+ d_j| over the root mean square length that agrees;
USUAL, FLOOR = 3.0, 0.2  # tightened to so many times the median of the certain edges, not below the latter
MIN_COMMON = 2  # near smears that must agree with both ends of a certain edge,
MIN_COMMON_SHARE = 0.5  # and their least share of those that agree with one
MIN_MERGE = 2  # least number of agreeing pairs across that merge two components,
MIN_MERGE_SHARE = 0.5  # and their least share of all pairs across, near ones and sparse ones:
SPARSE = 4  # those near among every fourth smear, for fields of a network have gaps
VALLEY, MIN_PART = 0.6, 0.05  # see `_parted`
BLOCK = 4  # side, in distances that count as near, of the blocks that a contradictory component falls into


@dataclass(frozen=True, kw_only=True, eq=False)
class SignComponents:
    """Smears grouped so that each group has one unknown sign.

    Parameters
    ----------
    label : ndarray of int, shape (N,)
        The component of every smear, 0 to count - 1, largest first.
    sign : ndarray of shape (N,)
        +1 or -1: displacements times sign are equally oriented inside a component.
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
        """Return the number of smears."""
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
        """Return the number of components (B,) that index sets (B, m) touch."""
        ordered = np.sort(self.label[samples], axis=1)
        touched: Labels = 1 + (np.diff(ordered, axis=1) != 0).sum(axis=1)
        return touched

    def subset(self, index: NDArray[np.int_] | NDArray[np.bool_] | slice) -> SignComponents:
        """Return the smears of an index or mask, relabelled."""
        return _relabelled(self.label[index], self.sign[index])


def no_components(count: int) -> SignComponents:
    """Return a component for every smear: no order is known of any other."""
    return SignComponents(label=np.arange(count), sign=np.ones(count))


def sign_components(matches: SmearMatches) -> SignComponents:
    """Return groups of smears, scattered anywhere, whose relative order is certain.

    Outliers and smears without like neighbours are mostly singletons. Deterministic; sigmas are not used.
    """
    count, points = len(matches), matches.midpoint
    if count < 2:
        return no_components(count)
    near, radius = near_pairs(points, NEIGHBOURS)
    edges = Edges.between(matches.displacement, near, MAX_DIFFERENCE)
    both, either = support(points, radius, near, edges)
    certain = edges.only((both >= MIN_COMMON) & (both >= MIN_COMMON_SHARE * either))
    limit = _limit(certain)
    certain = certain.only(certain.difference < limit)
    label, sign = consistent_signs(_ever_fewer(certain, points, radius, limit), count)
    touching = np.concatenate([near, _far_pairs(points, radius)], axis=1)
    edges = Edges.between(matches.displacement, touching, limit)
    joined, flip = consistent_signs([_joins(label, sign, touching, edges)], int(label.max()) + 1)
    parted = _parted(joined[label], edges, matches.length_px)
    return _relabelled(parted, sign * flip[label])


def _far_pairs(points: Array, radius: float) -> Labels:
    """Return the pairs (2, E) that are near among every fourth point alone."""
    sparse = np.arange(0, len(points), SPARSE)
    if len(sparse) < 2:
        return np.zeros((2, 0), int)
    pairs = sparse[near_pairs(points[sparse], NEIGHBOURS)[0]]
    apart = points[pairs[0]] - points[pairs[1]]
    return pairs[:, np.hypot(*apart.T) > radius]


def _limit(certain: Edges) -> float:
    """Return the greatest difference that agrees, tightened to what is usual on surfaces."""
    if not len(certain.i):
        return MAX_DIFFERENCE
    usual = USUAL * float(np.median(certain.difference))
    return float(np.clip(usual, FLOOR, MAX_DIFFERENCE))


def _ever_fewer(certain: Edges, points: Array, radius: float, limit: float) -> Iterator[Edges]:
    """Yield fewer and fewer edges, for components that contradict themselves; at last only inside blocks."""
    yield certain
    halved = certain.only(certain.difference < 0.5 * limit)
    yield halved
    block = np.floor(points / max(BLOCK * radius, 1e-9)).astype(int)
    yield halved.only((block[halved.i] == block[halved.j]).all(axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplePatterns:
    """Sign patterns of samples that touch equally many components.

    ``index`` (b,) says which samples these are; ``signs`` (b, P, m) are their patterns as
    `minimal_solvers.solve_seven_smears` takes them, P = 2^(touched - 1), the first sign of each +1.
    """

    index: Labels
    signs: Array


def sample_patterns(
    components: SignComponents, drawn: Labels, doubted: NDArray[np.bool_] | None = None
) -> list[SamplePatterns]:
    """Return the sign patterns that components leave for samples (B, m) of indices, grouped by their number.

    `no_components` leaves all 2^(m - 1) patterns, and so do samples that are ``doubted`` (B,), so that a
    search survives a wrong grouping. Every sample is in exactly one group; groups have growing numbers of
    patterns.

    Examples
    --------
    >>> for group in sample_patterns(components, drawn):
    ...     F, sample = solve_seven_smears(ends[drawn[group.index]], group.signs)
    ...     sample = group.index[sample]
    """
    label = components.label[drawn]  # (B, m)
    if doubted is not None:
        label[doubted] = np.arange(label.shape[1])
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


def _joins(label: Labels, sign: Array, near: Labels, edges: Edges) -> Edges:
    """Return edges between components that, where they touch, mostly agree in one relative sign."""
    count = int(label.max()) + 1
    across = np.flatnonzero(label[edges.i] != label[edges.j])
    i, j = edges.i[across], edges.j[across]
    key, index = np.unique(_pair_key(label[i], label[j], count), return_inverse=True)
    net = np.bincount(index, weights=edges.sign[across] * sign[i] * sign[j], minlength=len(key))
    touching = np.sort(_pair_key(label[near[0]], label[near[1]], count))
    total = np.searchsorted(touching, key, side="right") - np.searchsorted(touching, key)
    join = (np.abs(net) >= MIN_MERGE) & (np.abs(net) >= MIN_MERGE_SHARE * total)
    one, other = np.divmod(key[join], count)
    return Edges(i=one, j=other, sign=np.sign(net[join]), difference=np.zeros(len(one)))


def _parted(label: Labels, edges: Edges, length_px: Array) -> Labels:
    """Return labels in which components joined by short smears alone are split.

    Where the motion passes through zero it reverses, but smears on both sides look the same. Long is a smear
    of at least VALLEY times the upper quartile; parts of fewer long smears than MIN_PART of the
    component do not count.
    """
    count = int(label.max()) + 1
    order, sizes = np.lexsort((length_px, label)), np.bincount(label, minlength=count)
    quartile = length_px[order][np.cumsum(sizes) - 1 - sizes // 4]
    long = length_px >= VALLEY * quartile[label]
    joined = (label[edges.i] == label[edges.j]) & (long[edges.i] == long[edges.j])
    part = connected(edges.i[joined], edges.j[joined], len(label))
    size = np.bincount(part, weights=long)
    whole = np.zeros(len(size), int)
    whole[part] = label
    counts = np.bincount(whole[size >= np.maximum(MIN_PART * sizes[whole], 1)], minlength=count)
    return np.where(counts[label] > 1, count + part, label)


def _pair_key(one: Labels, other: Labels, count: int) -> Labels:
    return np.minimum(one, other) * count + np.maximum(one, other)


def _relabelled(label: Labels, sign: Array) -> SignComponents:
    """Return the components labelled 0, 1, ... by falling size."""
    sizes = np.bincount(label)
    rank = np.empty(len(sizes), int)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return SignComponents(label=rank[label], sign=sign)
