"""Cohesive links: springs between a vertex of one chain and a point of a segment of another.

With Δ from the point to the vertex, t along the segment and n across it,

    U = ½ k_n max(0, u_n)² + ½ k_t u_t²,   u = (n·Δ, t·Δ) less its value at the start        (SP.8)

Links pull but never push: contacts do that. U is of positions alone, so forces, and the couple on
the segment, which turns n and t, follow from it without increments, and all momenta are kept.
A link breaks for good where

    f_n/f_n⁰ + |f_t/f_t⁰|^α ≥ 1   (force), or   Σ U of both ends of an interface ≥ G_c L  (energy)
"""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.pairs import distance_to_segment
from shear_sim.models.soft_particle.state import BROKEN, Chains, Links


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
def link_forces(
    links: Links, x: Floats, y: Floats, after: Ints, fx: Floats, fy: Floats, energy: Floats
) -> None:
    """Break the links that bear too much, and add the forces of the others."""
    normal, tangential, fn0, ft0, exponent, toughness = links.law
    for q in range(links.vertex.shape[0]):
        if links.intact[q] == 0:
            continue
        un, ut = displacements(links, x, y, after, q)
        un = max(0.0, un)
        other = q
        if toughness > 0.0 and links.intact[links.brother[q]] == 1:
            other = links.brother[q]
        stored = 0.5 * (normal * un * un + tangential * ut * ut)
        # The work of a force that is gone at the end of the step: half of it, over all the way.
        lost = 0.5 * (links.pull[q] * un + links.shear[q] * ut)
        if toughness > 0.0:
            if other != q:
                un, ut = displacements(links, x, y, after, other)
                un = max(0.0, un)
                stored += 0.5 * (normal * un * un + tangential * ut * ut)
                lost += 0.5 * (links.pull[other] * un + links.shear[other] * ut)
            broken = stored >= toughness * links.length[q]
        else:
            broken = normal * un / fn0 + np.abs(tangential * ut / ft0) ** exponent >= 1.0
        if broken:
            energy[BROKEN] += lost
            links.intact[q] = links.intact[other] = 0

    for q in range(links.vertex.shape[0]):
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
        fx[v] += px
        fy[v] += py
        fx[k] -= (1.0 - w) * px
        fy[k] -= (1.0 - w) * py
        fx[j] -= w * px
        fy[j] -= w * py
        # The moment of the pair (f at v, −f at the point) is given back as a couple.
        dx = x[v] - x[k] - w * ex
        dy = y[v] - y[k] - w * ey
        couple = -(dx * py - dy * px) / square
        fx[j] -= couple * ey
        fy[j] += couple * ex
        fx[k] += couple * ey
        fy[k] -= couple * ex


@jit
def link_energy(links: Links, x: Floats, y: Floats, after: Ints) -> float:
    """Return the energy [J/m] of all links, Eq. (SP.8)."""
    total = 0.0
    for q in range(links.vertex.shape[0]):
        if links.intact[q] == 1:
            un, ut = displacements(links, x, y, after, q)
            total += 0.5 * (links.law[0] * max(0.0, un) ** 2 + links.law[1] * ut * ut)
    return total


def no_links() -> Links:
    """Return links that are none."""
    none, nothing = np.zeros(0, np.int32), np.zeros(0)
    return Links(
        none, none, none, none, nothing, nothing, nothing, nothing, nothing, nothing, np.ones(6)
    )


def glue(
    chains: Chains,
    x: Floats,
    y: Floats,
    reach: float,
    *,
    normal: float,
    tangential: float,
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
    strength : (float, float)
        f_n⁰ and f_t⁰ [N/m].
    exponent : float
        α.
    toughness : float
        G_c [N/m]: the energy criterion, if positive, instead of that of forces.

    Raises
    ------
    ValueError
        If no two chains are near.
    """
    near: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for p in range(len(chains.closed)):
        mine = np.arange(chains.start[p], chains.start[p + 1])
        reached = reach + chains.radius[p] + chains.radius.max()
        box = (
            (x > x[mine].min() - reached) & (x < x[mine].max() + reached)
            & (y > y[mine].min() - reached) & (y < y[mine].max() + reached)
        )  # fmt: skip
        box[mine] = False
        for v in map(int, np.flatnonzero(box)):
            other = int(chains.chain[v])
            touch = chains.radius[p] + chains.radius[other] + reach
            bars = mine[chains.after[mine] >= 0]
            ends = chains.after[bars]
            gap = np.array(
                [
                    distance_to_segment(x[v], y[v], x[a], y[a], x[b], y[b])
                    for a, b in zip(bars, ends, strict=True)
                ]
            )
            # Off a corner two segments are as near: the one that v faces is meant.
            ex, ey = x[ends] - x[bars], y[ends] - y[bars]
            faced = np.abs((x[v] - x[bars]) * ey - (y[v] - y[bars]) * ex) / np.hypot(ex, ey)
            best = int(np.where(gap <= gap.min() * (1 + 1e-6), faced, -1.0).argmax())
            if gap[best] <= touch:
                pair = (min(p, other), max(p, other))
                near.setdefault(pair, []).append((v, int(bars[best])))
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
            brother.append(len(chosen))
            chosen.append(found[one])
            length.append(2.0 * reach)
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
    none = np.zeros((4, len(vertex)))
    links = Links(
        vertex,
        segment,
        np.array(brother, np.int32),
        np.ones(len(vertex), np.int32),
        share,
        none[0],
        none[1],
        np.array(length),
        none[2],
        none[3],
        law,
    )
    for q in range(len(vertex)):
        links.across[q], links.along[q] = displacements(links, x, y, chains.after, q)
    return links
