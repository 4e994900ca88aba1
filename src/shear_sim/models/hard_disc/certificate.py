"""The proof that discs are jammed: a state of forces that bears itself, and what holds it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Instant, Jammed, approach


def constrained(
    i: NDArray[np.int32], j: NDArray[np.int32], fixed: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which discs have three contacts or more among themselves (eq. 29).

    Parameters
    ----------
    i, j : (n,)
        Discs of each contact.
    fixed : (N,)
        Which discs are immobile: they need no contacts to stay.
    """
    kept = np.ones(len(fixed), bool)
    while True:
        both = kept[i] & kept[j]
        contacts = sum(np.bincount(end[both], minlength=len(fixed)) for end in (i, j))
        loose = kept & (contacts < 3) & ~fixed
        if not loose.any():
            return kept
        kept &= ~loose


def bodies(i: NDArray[np.int32], j: NDArray[np.int32], discs: int) -> NDArray[np.int32]:
    """Return the number of the body of each disc, given the bonds (n,) between them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(i)), (i, j)), shape=(discs, discs))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int32)


BALANCED = 1e-12  # of the mean force: round-off of the sums of a disc's forces


def certify(now: Instant, jam: Jammed, path: float) -> dict[str, Any]:
    """Return the JSON-ready certificate of a jammed instant.

    Returns
    -------
    dict
        ``contacts`` N_c that bear force and ``discs`` N̄ on which they do, ``isostatic`` (integers:
        N_c = 2 N̄ − 1, or 2 N̄ + 1 where immobile discs, which do not count, hold the packing in
        place; and all these discs are `constrained`: equal ones can stand in rows on two contacts),
        ``least_force`` = min f₀/⟨f₀⟩ of what may only push, ``unbalanced_force`` = max |Sᵀf₀|/⟨f₀⟩,
        ``second_singular_value`` of S (unit rows) on the contacts that bear force, ``load`` =
        ⟨f₀|q⟩/⟨f₀⟩ (negative: f₀ resists), ``rattlers`` (numbers of the discs that bear none). The
        beads of a body are held together: all of them and all of their bonds count.
    """
    mobile = now.mobility > 0
    bonds = np.flatnonzero(now.permanent).astype(np.int32)
    pairs, phi = jam.pairs, jam.force
    i, j, rx, ry = now.contacts(pairs)
    if len(bonds):
        body = bodies(*now.contacts(bonds)[:2], len(mobile))
        held = np.isin(body, np.concatenate([body[i], body[j]]))
        missing = bonds[held[now.i[bonds]] & ~np.isin(bonds, pairs)]
        pairs, phi = np.append(pairs, missing), np.append(phi, np.zeros(len(missing)))
        i, j, rx, ry = now.contacts(pairs)
        whole = True
    else:
        held = np.isin(np.arange(len(mobile)), np.concatenate([i, j]))
        whole = np.array_equal(held & mobile, constrained(i, j, ~mobile) & mobile)
    held &= mobile
    pushing = now.permanent[pairs] == 0
    distance = np.hypot(rx, ry)
    force = phi * distance
    discs = len(mobile)
    matrix = np.zeros((len(i), 2 * discs))
    rows = np.arange(len(i))
    for side, sign in ((i, -1.0), (j, 1.0)):
        matrix[rows, 2 * side] = sign * rx / distance
        matrix[rows, 2 * side + 1] = sign * ry / distance
    matrix *= np.repeat(mobile, 2)
    # The direction comes from a factor that is nearly singular: what it leaves is taken off.
    force -= np.linalg.lstsq(matrix.T, matrix.T @ force, rcond=1e-10)[0]
    force /= force[pushing].mean()
    singular = np.linalg.svd(matrix, compute_uv=False)
    q = approach(i, j, rx, ry, now.drive.drift, now.drive.shear, now.drive.compression)
    contacts, bearing = len(i), int(held.sum())
    pinned = not (mobile[i] & mobile[j]).all()  # by immobile discs that bear force
    return {
        "path": path,
        "contacts": contacts,
        "discs": bearing,
        "isostatic": whole and contacts == 2 * bearing + (1 if pinned else -1),
        "least_force": float(force[pushing].min()),
        "unbalanced_force": float(np.abs(matrix.T @ force).max()),
        "smallest_singular_value": float(singular[-1]),
        "second_singular_value": float(singular[-2]) if len(singular) > 1 else 0.0,
        "load": float((force * q / distance).sum()),
        "rattlers": np.flatnonzero(mobile & ~held).tolist(),
    }


def is_proof(certificate: dict[str, Any]) -> bool:
    """Tell whether the forces of a certificate prove that discs are jammed.

    They push, they balance to round-off, and they resist the motion that was asked for.
    """
    return bool(
        certificate["least_force"] > 0
        and certificate["unbalanced_force"] <= BALANCED
        and certificate["load"] < 0
    )
