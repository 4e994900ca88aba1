"""The matrix of a contact network, its sparse LDLᵀ factor, and linear systems with both.

The contact matrix (HD.3) couples contacts that share a disc. Contacts come in the order of
:func:`shear_sim.models.hard_disc.pairs.elimination_order`, in which the factor stays sparse.
"""

from typing import NamedTuple

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit


class Factor(NamedTuple):
    """LDLᵀ of the contact matrix, or of all but its last row with a border (HD.8).

    L is stored by columns without its diagonal. At fixed pressure the last contact c is kept out of
    the factor: the matrix may be singular with it, although the bordered system is not.
    """

    begin: Ints  # (n₁ + 1,) where each column begins
    row: Ints  # (nnz,)
    value: Floats  # (nnz,)
    pivot: Floats  # (n₁,)
    border: Floats  # (4, n): column N_1c, N_11⁻¹ N_1c, m, N_11⁻¹ m_1; (4, 0) at fixed volume
    corner: Floats  # (3,): s = N_cc − N_c1 N_11⁻¹ N_1c, e = m_c − N_c1 N_11⁻¹ m_1, m_1ᵀ N_11⁻¹ m_1


@jit
def element(a: int, b: int, i: Ints, j: Ints, rx: Floats, ry: Floats, mobility: Floats) -> float:
    """Return the element (a, b) of N = S Ξ Sᵀ for two contacts."""
    shared = 0.0
    if i[a] == i[b]:
        shared += mobility[i[a]]
    if j[a] == j[b]:
        shared += mobility[j[a]]
    if i[a] == j[b]:
        shared -= mobility[i[a]]
    if j[a] == i[b]:
        shared -= mobility[j[a]]
    product: float = shared * (rx[a] * rx[b] + ry[a] * ry[b])
    return product


@jit
def factorise(
    leading: int, i: Ints, j: Ints, rx: Floats, ry: Floats, mobility: Floats
) -> tuple[Ints, Ints, Floats, Floats]:
    """Factor the contact matrix N = S Ξ Sᵀ, row by row (up-looking).

    Parameters
    ----------
    leading : int
        How many of the contacts to take, n₁.
    i, j : (n,)
        Discs of each contact.
    rx, ry : (n,)
        From disc i to the image of disc j in contact with it.
    mobility : (N,)
        ξ of each disc.

    Returns
    -------
    begin, row, value, pivot
        See `Factor`. Pivots of dependent contacts are 0 to round-off of N: `triangularise` tells
        them from small ones.
    """
    discs = mobility.shape[0]
    first = np.zeros(discs + 1, np.int32)
    for a in range(leading):
        first[i[a] + 1] += 1
        first[j[a] + 1] += 1
    for k in range(discs):
        first[k + 1] += first[k]
    fill = first[:-1].copy()
    member = np.empty(2 * leading, np.int32)
    for a in range(leading):
        member[fill[i[a]]] = a
        fill[i[a]] += 1
        member[fill[j[a]]] = a
        fill[j[a]] += 1

    # Elimination tree and column counts: row k reaches the ancestors of its entries below k.
    parent = np.full(leading, -1, np.int32)
    mark = np.full(leading, -1, np.int32)
    count = np.zeros(leading, np.int32)
    for k in range(leading):
        mark[k] = k
        for side in range(2):
            disc = i[k] if side == 0 else j[k]
            for q in range(first[disc], first[disc + 1]):
                b = member[q]
                if b >= k:
                    break
                while mark[b] != k:
                    if parent[b] == -1:
                        parent[b] = k
                    count[b] += 1
                    mark[b] = k
                    b = parent[b]
    begin = np.zeros(leading + 1, np.int32)
    for k in range(leading):
        begin[k + 1] = begin[k] + count[k]
    row = np.empty(begin[leading], np.int32)
    value = np.empty(begin[leading])
    pivot = np.empty(leading)
    end = begin[:-1].copy()
    work = np.zeros(leading)
    path = np.empty(leading, np.int32)
    pattern = np.empty(leading, np.int32)
    mark[:] = -1
    for k in range(leading):
        mark[k] = k
        top = leading
        for side in range(2):
            disc = i[k] if side == 0 else j[k]
            for q in range(first[disc], first[disc + 1]):
                b = member[q]
                if b >= k:
                    break
                work[b] = element(k, int(b), i, j, rx, ry, mobility)
                length = 0
                while mark[b] != k:
                    path[length] = b
                    length += 1
                    mark[b] = k
                    b = parent[b]
                while length > 0:
                    length -= 1
                    top -= 1
                    pattern[top] = path[length]
        diagonal = element(k, k, i, j, rx, ry, mobility)
        for q in range(top, leading):
            c = pattern[q]
            y = work[c]
            work[c] = 0.0
            for p in range(begin[c], end[c]):
                work[row[p]] -= value[p] * y
            low = y / pivot[c]
            diagonal -= low * y
            row[end[c]] = k
            value[end[c]] = low
            end[c] += 1
        pivot[k] = diagonal
    return begin, row, value, pivot


@jit
def triangularise(
    begin: Ints, row: Ints, i: Ints, j: Ints, rx: Floats, ry: Floats, mobility: Floats
) -> tuple[Floats, Floats]:
    """Return ``value`` and ``pivot`` of the same factor, by rotations of the rows of Ξ½ Sᵀ.

    Ξ½ Sᵀ = Q R and N = Rᵀ R, so L and D are those of R: with the digits that `factorise` loses by
    squaring where contacts nearly depend on each other (George & Heath, Linear Algebra Appl. 34
    (1980) 69). It costs a few times as much.

    Parameters
    ----------
    begin, row
        See `Factor`; as `factorise` returns them.
    i, j, rx, ry, mobility
        See `factorise`; contacts beyond the factor's are not looked at.
    """
    leading = begin.shape[0] - 1
    discs = mobility.shape[0]
    diagonal = np.zeros(leading)
    beside = np.zeros(row.shape[0])
    work = np.zeros(leading)
    first = np.zeros(discs + 1, np.int32)
    for a in range(leading):
        first[i[a] + 1] += 1
        first[j[a] + 1] += 1
    for d in range(discs):
        first[d + 1] += first[d]
    member = np.empty(2 * leading, np.int32)
    fill = first[:-1].copy()
    for a in range(leading):
        member[fill[i[a]]] = a
        fill[i[a]] += 1
        member[fill[j[a]]] = a
        fill[j[a]] += 1
    for d in range(discs):
        if first[d] == first[d + 1] or mobility[d] == 0.0:
            continue
        root = np.sqrt(mobility[d])
        for s in range(2):
            for q in range(first[d], first[d + 1]):
                a = member[q]
                r = rx[a] if s == 0 else ry[a]
                work[a] = -root * r if i[a] == d else root * r
            # Contacts of one disc are a clique: the row has entries along one path of columns only.
            k = member[first[d]]
            while True:
                if work[k] != 0.0:
                    length = np.hypot(diagonal[k], work[k])
                    cosine, sine = diagonal[k] / length, work[k] / length
                    diagonal[k] = length
                    work[k] = 0.0
                    for p in range(begin[k], begin[k + 1]):
                        above, below = beside[p], work[row[p]]
                        beside[p] = cosine * above + sine * below
                        work[row[p]] = cosine * below - sine * above
                if begin[k] == begin[k + 1]:
                    break
                k = row[begin[k]]
    for k in range(leading):
        for p in range(begin[k], begin[k + 1]):
            beside[p] = beside[p] / diagonal[k] if diagonal[k] > 0.0 else 0.0
        diagonal[k] *= diagonal[k]
    return beside, diagonal


@jit
def back_substitute(factor: Factor, b: Floats) -> None:
    """Overwrite ``b`` (n₁ or more, the first n₁ of them) with the solution of L D Lᵀ x = b."""
    begin, row, value, pivot = factor.begin, factor.row, factor.value, factor.pivot
    n = pivot.shape[0]
    for k in range(n):
        y = b[k]
        if y != 0.0:
            for p in range(begin[k], begin[k + 1]):
                b[row[p]] -= value[p] * y
    for k in range(n - 1, -1, -1):
        y = b[k] / pivot[k]
        for p in range(begin[k], begin[k + 1]):
            y -= value[p] * b[row[p]]
        b[k] = y


@jit
def bordered(factor: Factor, i: Ints, j: Ints, rx: Floats, ry: Floats, mobility: Floats) -> Factor:
    """Return the factor of all contacts but the last with the border of a fixed pressure."""
    n = i.shape[0]
    last = n - 1
    border = np.zeros((4, n))
    corner = np.zeros(3)
    for a in range(n):
        border[2, a] = rx[a] * rx[a] + ry[a] * ry[a]
    for a in range(last):
        border[0, a] = element(a, last, i, j, rx, ry, mobility)
        border[1, a] = border[0, a]
        border[3, a] = border[2, a]
    back_substitute(factor, border[1])
    back_substitute(factor, border[3])
    corner[0] = element(last, last, i, j, rx, ry, mobility)
    corner[1] = border[2, last]
    for a in range(last):
        corner[0] -= border[0, a] * border[1, a]
        corner[1] -= border[0, a] * border[3, a]
        corner[2] += border[2, a] * border[3, a]
    return Factor(factor.begin, factor.row, factor.value, factor.pivot, border, corner)


@jit
def solve(factor: Factor, b: Floats, load: float) -> float:
    """Solve N φ = b, or with a border N φ − κ m = b and mᵀφ = load (HD.8).

    Parameters
    ----------
    factor : Factor
        Of N.
    b : (n,)
        Overwritten with φ.
    load : float
        Not looked at without a border.

    Returns
    -------
    κ, 0 without a border.
    """
    back_substitute(factor, b)
    border = factor.border
    if border.shape[1] == 0:
        return 0.0
    n1 = factor.pivot.shape[0]
    force = b[n1]
    for a in range(n1):
        force -= border[0, a] * b[a]
        load -= border[2, a] * b[a]
    # [[s, −e], [e, M]] (φ_c, κ) = (force, load): its determinant is never 0, though s may be.
    s, e, m = factor.corner
    determinant = s * m + e * e
    last = (force * m + e * load) / determinant
    kappa: float = (s * load - e * force) / determinant
    for a in range(n1):
        b[a] += kappa * border[3, a] - last * border[1, a]
    b[n1] = last
    return kappa
