"""F from many smears without any order, linearly: the equation q^2 = l^2 knows no signs.

With X = (x y^T + y x^T) / 2 for a smear's ends x, y the two factors' product (x^T F y)(y^T F x) = q^2 - l^2
is a quadratic form in the six entries of X, since q = <S, X> and l^2 = -4 a^T adj(X) a: 21 monomials, so 20
smears fix the form W up to scale. Its part that is symmetric in all four indices is that of S (x) S, from
which S follows in closed form; what remains is 4 a^T adj(X) a, which gives a. The relative sign of S and a
is the direction of time and stays open. A pure translation leaves the form undetermined (three forms vanish),
and little rotation nearly does.

Exact on exact smears, but of no use beside the robust search, so no loop calls it. As a start for
`refine.refine` (the solution of 400 of 1500 smears of 20 px reweighted four times, 3 ms; 24 scenes per cell)
it ended at a median rho below 0.02 in 88 % of smooth and 62 % of scattered scenes at 1 px of noise, in 71 and
88 % with 30 % outliers, in 67 and 54 % with 50 %. From all smears, reweighted eight times, at 0.25 to 1 px it
did so in 75 to 100 % of 12 scenes per cell where the seven-smear search did in all, and its refined cost was
less than those from the search and from the two-parameter F in 0 to 8 % (0 to 42 % with correlated noise,
at no lower rho).
"""

from __future__ import annotations

import numpy as np

from blur2view.epipolar import (
    TINY,
    Array,
    apply_similarity,
    denormalise,
    join_symmetric_skew,
    quadratic_features,
    shared_normalisation,
    symmetric_from_vector,
    unit_norm,
)
from blur2view.hypotheses import half_sphere

LEAST = 20  # smears that fix 21 homogeneous coefficients
UPPER = np.triu_indices(6)
PAIRS = np.triu_indices(3)
HALVES: Array = np.array([1.0, 0.5, 0.5, 1.0, 0.5, 1.0])  # entries of X from the coefficients of q in S
PROBES: Array = half_sphere(100)


def sign_free_fundamental(ends: Array, weights: Array | None = None) -> Array | None:
    """Solve F linearly from smears without order; not robust, and of an algebraic error.

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2)
        Pixels, N at least 20.
    weights : ndarray of shape (N,), optional
        Factors of the equations; default 1.

    Returns
    -------
    ndarray of shape (3, 3) or None
        Unit norm, rank 2, F or its transpose. None where the smears leave the form undetermined: a plane, a
        pure rotation, a pure translation.

    Raises
    ------
    ValueError
        If there are fewer than 20 smears.
    """
    if len(ends) < LEAST:
        raise ValueError(f"need at least {LEAST} smears, got {len(ends)}")
    T = shared_normalisation(ends)
    normalised = apply_similarity(T, ends.reshape(-1, 2)).reshape(ends.shape)
    monomials = form_monomials(normalised)
    triangle = np.linalg.qr(monomials if weights is None else monomials * weights[:, None], mode="r")
    _, singular, Vt = np.linalg.svd(triangle)
    if singular[LEAST - 1] <= 1e-12 * singular[0]:
        return None
    S, a = split_form(Vt[-1])
    F = join_symmetric_skew(S, a)
    if not np.linalg.norm(F) > 0:
        return None
    U, values, Vt = np.linalg.svd(F)
    return unit_norm(denormalise((U[:, :2] * values[:2]) @ Vt[:2], T))


def form_monomials(ends: Array) -> Array:
    """Give the 21 monomials (N, 21) whose form is (x^T F y)(y^T F x) for smears (N, 2, 2)."""
    features, _ = quadratic_features(ends)
    monomials: Array = features[:, UPPER[0]] * features[:, UPPER[1]]
    return monomials


def form_of(S: Array, a: Array) -> Array:
    """Coefficients (21,) of q^2 - l^2 for `form_monomials`."""
    s = S[PAIRS]
    square = np.outer(s, s)
    coefficients: Array = _coefficients(square) + 4 * (a[PAIRS[0]] * a[PAIRS[1]]) @ ADJUGATE
    return coefficients


def split_form(coefficients: Array) -> tuple[Array, Array]:
    """Give S (3, 3) and a (3,) of a form (21,), any scale and sign; exact where it is one of an F.

    With T the fully symmetric part, T(p, p, p, v) = (p^T S p)(p^T S v) and
    3 T(p, p, v, w) = (p^T S p)(v^T S w) + 2 (p^T S v)(p^T S w), at a direction p where p^T S p is large.
    """
    tensor = _symmetric_tensor(coefficients)
    at_probes = np.einsum("ijkl,pi,pj,pk,pl->p", tensor, *[PROBES] * 4)
    p, value = PROBES[np.argmax(np.abs(at_probes))], at_probes[np.argmax(np.abs(at_probes))]
    if value < 0:
        coefficients, tensor, value = -coefficients, -tensor, -value
    twice = np.einsum("ijkl,i,j->kl", tensor, p, p)
    root = np.sqrt(max(value, TINY))
    along = twice @ p / root
    S = (3 * twice - 2 * np.outer(along, along)) / root
    s = S[PAIRS]
    rest = (coefficients - _coefficients(np.outer(s, s))) @ np.linalg.pinv(ADJUGATE) / 4
    eigenvalues, vectors = np.linalg.eigh(symmetric_from_vector(rest))
    return S, vectors[:, 2] * np.sqrt(max(float(eigenvalues[2]), 0.0))


def _coefficients(form: Array) -> Array:
    """Coefficients (21,) of a symmetric form (6, 6)."""
    doubled: Array = (form + form.T - np.diag(np.diag(form)))[UPPER]
    return doubled


def _symmetric_tensor(coefficients: Array) -> Array:
    """Fully symmetric part (3, 3, 3, 3) of a form (21,) as a function of X (x) X."""
    form = np.zeros((6, 6))
    form[UPPER] = coefficients
    form = 0.5 * (form + form.T)
    spread = symmetric_from_vector(np.eye(6))  # (6, 3, 3): feature k is <spread_k, X>
    tensor = np.einsum("aij,ab,bkl->ijkl", spread, form, spread)
    symmetric: Array = (tensor + tensor.transpose(0, 2, 1, 3) + tensor.transpose(0, 3, 2, 1)) / 3
    return symmetric


def _adjugate_forms() -> Array:
    """Forms (6, 21) of 2 - delta_ij times adj(X)_ij, i <= j, in the features (X11, 2 X12, ..., X33)."""
    index = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    forms = np.zeros((6, 6, 6))
    for row, (i, j) in enumerate(zip(*PAIRS, strict=True)):
        (r, s), (t, u) = ([k for k in range(3) if k != i], [k for k in range(3) if k != j])
        factor = (1.0 if i == j else 2.0) * (-1.0) ** (i + j)
        for one, other, sign in ((index[r, t], index[s, u], 1.0), (index[r, u], index[s, t], -1.0)):
            scale = 0.5 * factor * sign * HALVES[one] * HALVES[other]
            forms[row, one, other] += scale
            forms[row, other, one] += scale
    return np.stack([_coefficients(form) for form in forms])


ADJUGATE: Array = _adjugate_forms()
