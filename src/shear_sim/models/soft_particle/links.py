"""Cohesive links: springs between a vertex of one chain and a point of a segment of another.

With Δ from the point to the vertex, t along the segment and n across it,

    U = ½ k_n max(0, u_n)² + ½ k_t u_t²,   u = (n·Δ, t·Δ) less its value at the start        (SP.8)

Links pull but never push: contacts do that. U is of positions alone, so forces, and the couple on
the segment, which turns n and t, follow from it without increments, and all momenta are kept.
A link breaks for good where

    f_n/f_n⁰ + |f_t/f_t⁰|^α ≥ 1   (force), or   Σ U of both ends of an interface ≥ G_c L  (energy)
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.checks import not_negative, positive
from shear_sim.models.soft_particle.state import BROKEN, Chains, Links, Mail, Strips
from shear_sim.models.soft_particle.strips import add

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

BISECTIONS = 60


@jit
def displacements(links: Links, x: Floats, y: Floats, after: Ints, q: int) -> tuple[float, float]:
    """Return u_n and u_t [m] of link ``q``."""
    v, k = links.vertex[q], links.segment[q]
    j = after[k]
    ex, ey = x[j] - x[k], y[j] - y[k]
    length = np.sqrt(ex * ex + ey * ey)
    dx = x[v] - x[k] - links.share[q] * ex
    dy = y[v] - y[k] - links.share[q] * ey
    # Outwards of a ring, so that n·Δ > 0.
    across = (dx * ey - dy * ex) / length
    along = (dx * ex + dy * ey) / length
    return across - links.across[q], along - links.along[q]


@jit
def stored_energy(links: Links, un: float, ut: float) -> float:
    """Return U [J/m] of a link displaced by ``un`` and ``ut`` [m], Eq. (SP.8)."""
    opening = max(0.0, un)
    return float(0.5 * (links.law[0] * opening * opening + links.law[1] * ut * ut))


@jit
def cut(links: Links, x: Floats, y: Floats, after: Ints, q: int, energy: Floats) -> None:
    """Break link ``q``.

    What it loses is the work of a force that is gone at the end of the step: half of it, over all
    the way.
    """
    un, ut = displacements(links, x, y, after, q)
    links.lost[q] = 0.5 * (links.pull[q] * max(0.0, un) + links.shear[q] * ut)
    links.intact[q] = 0
    energy[BROKEN] += links.lost[q]


@jit
def link_forces(
    links: Links, x: Floats, y: Floats, after: Ints, fx: Floats, fy: Floats, energy: Floats,
    strips: Strips, strip: int, letters: Mail,
) -> None:  # fmt: skip
    """Break the links of a strip that bear too much, and add the forces of the others."""
    normal, tangential, fn0, ft0, exponent, toughness = links.law
    first, end = strips.vertex[strip], strips.vertex[strip + 1]
    for q in range(strips.link[strip], strips.link[strip + 1]):
        if links.intact[q] == 0:
            continue
        un, ut = displacements(links, x, y, after, q)
        other = q
        if toughness > 0.0:
            stored = stored_energy(links, un, ut)
            if links.intact[links.brother[q]] == 1 and links.brother[q] != q:
                other = links.brother[q]
                un, ut = displacements(links, x, y, after, other)
                stored += stored_energy(links, un, ut)
            broken = stored >= toughness * links.length[q]
        else:
            pulled = normal * max(0.0, un) / fn0
            broken = pulled + np.abs(tangential * ut / ft0) ** exponent >= 1.0
        if broken:
            cut(links, x, y, after, q, energy)
            if other != q:
                cut(links, x, y, after, other, energy)

    for q in range(strips.link[strip], strips.link[strip + 1]):
        if links.intact[q] == 0:
            continue
        un, ut = displacements(links, x, y, after, q)
        fn, ft = -normal * max(0.0, un), -tangential * ut
        links.pull[q], links.shear[q] = -fn, -ft
        v, k, w = links.vertex[q], links.segment[q], links.share[q]
        j = after[k]
        ex, ey = x[j] - x[k], y[j] - y[k]
        square = ex * ex + ey * ey
        length = np.sqrt(square)
        tx, ty = ex / length, ey / length
        px, py = fn * ty + ft * tx, -fn * tx + ft * ty
        mine = first <= v < end
        own = first <= k < end
        add(mine, fx, fy, v, px, py, letters, strip)
        add(own, fx, fy, k, -(1.0 - w) * px, -(1.0 - w) * py, letters, strip)
        add(own, fx, fy, j, -w * px, -w * py, letters, strip)
        # The moment of the pair (f at v, −f at the point) is given back as a couple.
        dx = x[v] - x[k] - w * ex
        dy = y[v] - y[k] - w * ey
        couple = -(dx * py - dy * px) / square
        add(own, fx, fy, j, -couple * ey, couple * ex, letters, strip)
        add(own, fx, fy, k, couple * ey, -couple * ex, letters, strip)


@jit
def link_energy(links: Links, x: Floats, y: Floats, after: Ints) -> float:
    """Return the energy [J/m] of all links, Eq. (SP.8)."""
    total = 0.0
    for q in range(links.vertex.shape[0]):
        if links.intact[q] == 1:
            un, ut = displacements(links, x, y, after, q)
            total += stored_energy(links, un, ut)
    return total


def energy_at_criterion(links: Links) -> FloatArray:
    """Return the energy (L,) [J/m] at which each broken link should have broken; 0 of the others.

    Its last forces, scaled until they fulfil the criterion just so: W₀ = f_n⁰²/2k_n where it was
    pulled alone. By the criterion of energies, its share of G_c L.
    """
    normal, tangential, fn0, ft0, exponent, toughness = links.law
    stored = 0.5 * (links.pull**2 / normal + links.shear**2 / tangential)
    broken = (links.intact == 0) & (stored > 0.0)
    if toughness > 0.0:
        alone = links.brother == np.arange(len(stored))
        both = stored + np.where(alone, 0.0, stored[links.brother])
        scale = toughness * links.length / np.where(broken, both, 1.0)
        return np.where(broken, scale * stored, 0.0)
    pulled = np.where(broken, links.pull / fn0, 1.0)
    sheared = np.where(broken, np.abs(links.shear / ft0), 1.0)
    low, high = np.zeros(len(stored)), 1.0 / np.maximum(pulled, sheared)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        beyond = middle * pulled + (middle * sheared) ** exponent >= 1.0
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.where(broken, high**2 * stored, 0.0)


def no_links() -> Links:
    """Return links that are none."""
    none, nothing = np.zeros(0, np.int32), np.zeros(0)
    return Links(
        none, none, none, none,
        nothing, nothing, nothing, nothing, nothing, nothing, nothing, np.ones(6),
    )  # fmt: skip


def glue(
    chains: Chains,
    x: Floats,
    y: Floats,
    reach: float,
    *,
    normal: float,
    tangential: float,
    between: Sequence[tuple[int, int]] | None = None,
    strength: tuple[float, float] = (1.0, 1.0),
    exponent: float = 2.0,
    toughness: float = 0.0,
) -> Links:
    """Return two links between every two chains that are near, at the ends of their interface.

    Parameters
    ----------
    reach : float
        Largest gap between two surfaces that are glued [m].
    normal, tangential : float
        k_n and k_t of a link [N/m²].
    between : sequence of (int, int), optional
        Chains to be linked, two and two; default: all that are near.
    strength : (float, float)
        f_n⁰ and f_t⁰ [N/m].
    exponent : float
        α.
    toughness : float
        G_c [N/m]: the energy criterion, if positive, instead of that of forces.

    Raises
    ------
    ValueError
        If no two chains are near, or two of ``between`` are not, or a number means nothing.
    """
    positive(normal=normal, tangential=tangential)
    not_negative(reach=reach, toughness=toughness, strength=strength)
    if toughness == 0.0:
        positive(strength=strength)
    if not 1.0 <= exponent < np.inf:
        msg = f"exponent = {exponent:g} must be finite and at least 1"
        raise ValueError(msg)
    near = _near(chains, x, y, reach)
    if between is not None:
        near = {pair: near.get(pair, []) for pair in map(_ordered, between)}
        for pair, found in near.items():
            if not found:
                raise ValueError(_apart(chains, x, y, pair, reach))
    if not near:
        msg = f"no two particles are within {reach:g} m of each other: nothing to glue"
        raise ValueError(msg)
    chosen: list[tuple[int, int]] = []
    brother: list[int] = []
    length: list[float] = []
    for found in near.values():
        at = np.array([v for v, _ in found])
        far = np.hypot(x[at][:, None] - x[at], y[at][:, None] - y[at])
        one, last = np.unravel_index(int(far.argmax()), far.shape)
        if one == last:
            v, k = found[one]
            brother.append(len(chosen))
            chosen.append((v, k))
            length.append(float(chains.rest_length[k]))
            continue
        brother += [len(chosen) + 1, len(chosen)]
        chosen += [found[one], found[last]]
        length += [float(far.max())] * 2
    vertex, segment = np.array(chosen, np.int32).T.copy()
    j = chains.after[segment]
    ex, ey = x[j] - x[segment], y[j] - y[segment]
    square = ex**2 + ey**2
    share = ((x[vertex] - x[segment]) * ex + (y[vertex] - y[segment]) * ey) / square
    share = np.clip(share, 0.0, 1.0)
    law = np.array([normal, tangential, *strength, exponent, toughness])
    count = len(vertex)
    none = np.zeros((5, count))
    links = Links(
        vertex, segment, np.array(brother, np.int32), np.ones(count, np.int32), share,
        none[0], none[1], np.array(length), none[2], none[3], none[4], law,
    )  # fmt: skip
    for q in range(count):
        links.across[q], links.along[q] = displacements(links, x, y, chains.after, q)
    return links


def _ordered(pair: tuple[int, int]) -> tuple[int, int]:
    return min(pair), max(pair)


def _near(
    chains: Chains, x: Floats, y: Floats, reach: float
) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Return for every two chains within ``reach`` the vertices there, each with its segment."""
    near: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for p in range(len(chains.closed)):
        mine = np.arange(chains.start[p], chains.start[p + 1])
        reached = reach + chains.radius[p] + chains.radius.max()
        box = (
            (x > x[mine].min() - reached) & (x < x[mine].max() + reached)
            & (y > y[mine].min() - reached) & (y < y[mine].max() + reached)
        )  # fmt: skip
        box[mine] = False
        who = np.flatnonzero(box)
        bars = mine[chains.after[mine] >= 0]
        gap, faced = _distances(x, y, who, bars, chains.after[bars])
        # Off a corner two segments are as near: the one that v faces is meant.
        nearest = gap.min(axis=1, keepdims=True)
        best = np.where(gap <= nearest * (1 + 1e-6), faced, -1.0).argmax(axis=1)
        touch = chains.radius[p] + chains.radius[chains.chain[who]] + reach
        for at in np.flatnonzero(nearest[:, 0] <= touch):
            v = int(who[at])
            pair = _ordered((p, int(chains.chain[v])))
            near.setdefault(pair, []).append((v, int(bars[best[at]])))
    return near


def _distances(
    x: Floats, y: Floats, who: IndexArray, bars: IndexArray, ends: Ints
) -> tuple[FloatArray, FloatArray]:
    """Return the distances (n, m) [m] of vertices from segments, and from the lines of these."""
    ex, ey = x[ends] - x[bars], y[ends] - y[bars]
    square = ex**2 + ey**2
    qx, qy = x[who][:, None] - x[bars], y[who][:, None] - y[bars]
    along = np.clip((qx * ex + qy * ey) / square, 0.0, 1.0)
    distance = np.hypot(qx - along * ex, qy - along * ey)
    return np.asarray(distance), np.asarray(np.abs(qx * ey - qy * ex) / np.sqrt(square))


def _apart(chains: Chains, x: Floats, y: Floats, pair: tuple[int, int], reach: float) -> str:
    """Return why two chains cannot be linked."""
    who = f"particles {pair[0]} and {pair[1]} cannot be linked"
    if not 0 <= pair[0] < pair[1] < len(chains.closed):
        return f"{who}: they must be two of the {len(chains.closed)} there are, from 0 on"
    gap = np.inf
    for one, other in (pair, pair[::-1]):
        bars = np.arange(chains.start[one], chains.start[one + 1])
        bars = bars[chains.after[bars] >= 0]
        theirs = np.arange(chains.start[other], chains.start[other + 1])
        gap = min(gap, float(_distances(x, y, theirs, bars, chains.after[bars])[0].min()))
    gap -= float(chains.radius[pair[0]] + chains.radius[pair[1]])
    return (
        f"{who}: there is a gap of {gap:.3g} m between them, and only neighbours within {reach:.3g}"
        " m of each other have an interface"
    )
