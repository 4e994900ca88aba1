"""The proof that discs are jammed: a state of forces that bears itself, and what holds it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Instant, Jammed, approach


def constrained(i: NDArray[np.int32], j: NDArray[np.int32], discs: int) -> NDArray[np.bool_]:
    """Return which of ``discs`` discs have three contacts or more among themselves (eq. 29)."""
    kept = np.ones(discs, bool)
    while True:
        both = kept[i] & kept[j]
        contacts = np.bincount(i[both], minlength=discs) + np.bincount(j[both], minlength=discs)
        loose = kept & (contacts < 3)
        if not loose.any():
            return kept
        kept &= ~loose


BALANCED = 1e-12  # of the mean force: round-off of the sums of a disc's forces


def certify(now: Instant, jam: Jammed, path: float) -> dict[str, Any]:
    """Return the JSON-ready certificate of a jammed instant.

    Returns
    -------
    dict
        ``contacts`` N_c and ``discs`` N̄ of the constrained subset, ``isostatic`` (N_c = 2 N̄ − 1 in
        integers), ``least_force`` = min f₀/⟨f₀⟩, ``unbalanced_force`` = max |Sᵀf₀|/⟨f₀⟩,
        ``second_singular_value`` of S (unit rows) on the contacts that bear force, ``load`` =
        ⟨f₀|q⟩/⟨f₀⟩ (negative: f₀ resists), ``rattlers`` (numbers of the discs that bear none).
    """
    i, j, rx, ry = now.contacts(jam.pairs)
    distance = np.hypot(rx, ry)
    force = jam.force * distance
    discs = len(now.mobility)
    held = constrained(i, j, discs)
    matrix = np.zeros((len(i), 2 * discs))
    rows = np.arange(len(i))
    for side, sign in ((i, -1.0), (j, 1.0)):
        matrix[rows, 2 * side] = sign * rx / distance
        matrix[rows, 2 * side + 1] = sign * ry / distance
    # The direction comes from a factor that is nearly singular: what it leaves is taken off.
    force -= np.linalg.lstsq(matrix.T, matrix.T @ force, rcond=1e-10)[0]
    force /= force.mean()
    singular = np.linalg.svd(matrix, compute_uv=False)
    q = approach(i, j, rx, ry, now.drive.drift, now.drive.shear, now.drive.compression)
    contacts, bearing = len(i), int(held.sum())
    return {
        "path": path,
        "contacts": contacts,
        "discs": bearing,
        "isostatic": contacts == 2 * bearing - 1,
        "least_force": float(force.min()),
        "unbalanced_force": float(np.abs(matrix.T @ force).max()),
        "smallest_singular_value": float(singular[-1]),
        "second_singular_value": float(singular[-2]) if len(singular) > 1 else 0.0,
        "load": float((force * q / distance).sum()),
        "rattlers": np.flatnonzero(~held).tolist(),
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
