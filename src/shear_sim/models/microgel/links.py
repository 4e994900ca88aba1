"""Permanent links: which touching pairs are linked, and how the network is cut into particles.

Everything here is geometry and graphs of one packing, made once per job: plain NumPy, and plain
lists where discs are followed one by one.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.parameters import Links
from shear_sim.neighbours import find_pairs
from shear_sim.streams import Streams

Bools = NDArray[np.bool_]
CUT_ATTEMPTS = 1000  # before a cut that avoids particles as high as the cell is given up


class Network(NamedTuple):
    """Touching pairs of a packing at zero strain; positions in the cell [m], P pairs."""

    position: NDArray[np.float64]  # (N, 2)
    radius: NDArray[np.float64]  # (N,)
    pairs: NDArray[np.int64]  # (P, 2) discs i < j
    image: NDArray[np.int64]  # (P, 2) image of j
    cell: tuple[float, float]  # width, height [m]
    periodic: bool = True

    @property
    def branch(self) -> NDArray[np.float64]:
        """Vectors (P, 2) from i to the image of j [m]."""
        i, j = self.pairs.T
        branch: NDArray[np.float64] = (
            self.position[j] + self.image * np.asarray(self.cell) - self.position[i]
        )
        return branch


def make_links(network: Network, section: Links, streams: Streams) -> tuple[Bools, dict[str, Any]]:
    """Choose the links of a packing.

    Returns
    -------
    linked : (P,)
        Which pairs are permanent links.
    report : dict
        Numbers of links and particles, and the fraction of links removed.

    Raises
    ------
    SimulationError
        If every cut leaves a particle that spans the height of the cell.
    """
    linked = np.full(len(network.pairs), section.cut != "none")
    if section.cut == "none":
        return linked, {"links": 0, "particles": len(network.radius)}
    if section.cut in ("cells", "lines") or section.cut_top_bottom:
        linked = _cut(network, section, streams)
    before = int(linked.sum())
    non_essential = before - _forest(network, linked, np.flatnonzero(linked)).sum()
    removed = 0
    if section.remove_fraction > 0:
        linked, removed = _remove(network, linked, section.remove_fraction, streams)
    joined = 0
    if section.join_isolated:
        linked, joined = _join_isolated(network, linked, section, streams)
    report = {
        "links": int(linked.sum()),
        "particles": int(particles(network, linked).max()) + 1,
        "links_before_removal": before,
        "non_essential_links": int(non_essential),
        "removed_links": removed,
        "removed_fraction": removed / before if before else 0.0,
        "removed_of_non_essential": float(removed / non_essential) if non_essential else 0.0,
        "joined_isolated": joined,
    }
    return linked, report


def particles(network: Network, linked: Bools) -> NDArray[np.int64]:
    """Return for every disc (N,) the number of its particle, a cluster of linked discs."""
    root = list(range(len(network.radius)))
    for i, j in network.pairs[linked].tolist():
        _join(root, i, j)
    return np.unique([_find(root, i) for i in root], return_inverse=True)[1]


def heights(network: Network, linked: Bools) -> NDArray[np.float64]:
    """Return the height of each particle [m], ∞ if it is linked to an image of itself above it."""
    y, radius = network.position[:, 1].tolist(), network.radius.tolist()
    neighbours: list[list[tuple[int, float]]] = [[] for _ in y]
    branch = network.branch[linked, 1].tolist()
    for (i, j), dy in zip(network.pairs[linked].tolist(), branch, strict=True):
        neighbours[i].append((j, dy))
        neighbours[j].append((i, -dy))
    number = particles(network, linked).tolist()
    low = [math.inf] * (max(number) + 1)
    high = [-math.inf] * len(low)
    unwrapped: list[float | None] = [None] * len(y)
    for seed, start in enumerate(y):
        if unwrapped[seed] is not None:
            continue
        unwrapped[seed] = start
        stack = [(seed, start)]
        while stack:
            i, here = stack.pop()
            p = number[i]
            low[p] = min(low[p], here - radius[i])
            high[p] = max(high[p], here + radius[i])
            for j, dy in neighbours[i]:
                there = unwrapped[j]
                if there is None:
                    unwrapped[j] = here + dy
                    stack.append((j, here + dy))
                elif abs(there - here - dy) > 0.5 * network.cell[1]:
                    high[p] = math.inf
    tall: NDArray[np.float64] = np.array(high) - np.array(low)
    return tall


def _find(root: list[int], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


def _join(root: list[int], i: int, j: int) -> bool:
    """Make one cluster of those of i and j; tell whether they were two."""
    a, b = _find(root, i), _find(root, j)
    root[max(a, b)] = min(a, b)
    return a != b


def _cut(network: Network, section: Links, streams: Streams) -> Bools:
    """Cut the full network by random cells or lines, again until no particle spans the height."""
    rng = streams.generator("cut")
    # Fewer than two cells, or no line, cannot cut a network that spans the height.
    can_avoid = section.cuts > 1 if section.cut == "cells" else section.cuts > 0
    avoid = section.avoid_height_spanning and section.cut != "bulk" and can_avoid
    for _ in range(CUT_ATTEMPTS):
        linked = np.ones(len(network.pairs), bool)
        if section.cut_top_bottom:
            # The edges of the cell are horizontal lines: what crosses them changes image.
            linked &= network.image[:, 1] == 0
        if section.cut == "cells":
            linked &= ~_between_cells(network, section, rng)
        elif section.cut == "lines":
            linked &= ~_across_lines(network, section, rng)
        if not avoid:
            return linked
        # Discs that are joined later (the same ones, as removal isolates none) count already.
        whole = linked
        if section.join_isolated:
            whole, _ = _join_isolated(network, linked, section, streams)
        if heights(network, whole).max() <= 0.9 * network.cell[1]:
            return linked
    msg = (
        f"no cut in {CUT_ATTEMPTS} tries left all particles lower than 0.9 of the cell's height: "
        f"raise model.links.cuts = {section.cuts}, or set model.links.avoid_height_spanning: false"
    )
    raise SimulationError(msg)


def _between_cells(network: Network, section: Links, rng: np.random.Generator) -> Bools:
    """Tell which pairs (P,) lie in different Voronoi cells of random points."""
    points = rng.random((section.cuts, 2)) * network.cell
    noise = rng.random((len(network.radius), section.cuts))
    if section.cuts < 2:
        return np.zeros(len(network.pairs), bool)
    apart = network.position[:, None, :] - points
    if network.periodic:
        apart -= np.rint(apart / network.cell) * network.cell
    distance = np.hypot(apart[..., 0], apart[..., 1])
    distance += section.edge_fuzziness * network.radius.max() * noise
    cell = distance.argmin(axis=1)
    apart_in: Bools = cell[network.pairs[:, 0]] != cell[network.pairs[:, 1]]
    return apart_in


def _across_lines(network: Network, section: Links, rng: np.random.Generator) -> Bools:
    """Tell which pairs (P,) are cut by random straight lines through the cell.

    As in the document a line ends at the cell's edges; a pair across an edge is tested from
    both of its ends.
    """
    cut = np.zeros(len(network.pairs), bool)
    i, j = network.pairs.T
    branch = network.branch
    avoid = np.deg2rad(section.avoid_angle)
    for _ in range(section.cuts):
        point = rng.random(2) * network.cell
        # The line's own angle to the horizontal, uniform where it is allowed.
        angle = rng.uniform(avoid, np.pi - avoid)
        normal = np.array([-np.sin(angle), np.cos(angle)])
        for end, to in ((i, branch), (j, -branch)):
            side = (network.position[end] - point) @ normal
            cut |= side * (side + to @ normal) <= 0
    return cut


def _forest(network: Network, linked: Bools, order: NDArray[np.int64]) -> Bools:
    """Tell which links (in ``order``) close a cycle when links are added from last to first."""
    root = list(range(len(network.radius)))
    last_first = order[::-1]
    joins = [_join(root, i, j) for i, j in network.pairs[last_first].tolist()]
    closes = np.zeros(len(linked), bool)
    closes[last_first] = ~np.array(joins, bool)
    return ~closes & linked


def _remove(
    network: Network, linked: Bools, fraction: float, streams: Streams
) -> tuple[Bools, int]:
    """Remove a fraction of the links that no particle needs to hold together, at random.

    A link can go if the links that are left still join its ends. Going through a random order
    once, that is so exactly for the links outside the spanning forest of the reversed order
    (reverse-delete is Kruskal's dual), whatever has been removed before.
    """
    order = streams.generator("link removal").permutation(np.flatnonzero(linked))
    forest = _forest(network, linked, order)
    free = order[~forest[order]]
    going = free[: round(fraction * len(free))]
    kept = linked.copy()
    kept[going] = False
    return kept, len(going)


def _join_isolated(
    network: Network, linked: Bools, section: Links, streams: Streams
) -> tuple[Bools, int]:
    """Link each disc without links to one of the discs it touches, chosen at random.

    Where top and bottom are cut, not through them.
    """
    rng = streams.generator("isolated discs")
    linked = linked.copy()
    degree = np.bincount(network.pairs[linked].ravel(), minlength=len(network.radius))
    allowed = np.ones(len(linked), bool)
    if section.cut_top_bottom:
        allowed = network.image[:, 1] == 0
    joined = 0
    for i in np.flatnonzero(degree == 0):
        if degree[i]:
            continue  # joined by an earlier one
        touching = np.flatnonzero((network.pairs == i).any(axis=1) & allowed)
        if len(touching):
            q = rng.choice(touching)
            linked[q] = True
            degree[network.pairs[q]] += 1
            joined += 1
    return linked, joined


def touching_pairs(
    position: NDArray[np.float64],
    radius: NDArray[np.float64],
    cell: tuple[float, float],
    periodic: bool = True,
) -> Network:
    """Return the network of all touching pairs at zero strain."""
    x, y = np.ascontiguousarray(position.T)
    if periodic:
        width, height = cell
    else:
        # A cell so large that no image is near anybody.
        x, y = x - x.min(), y - y.min()
        width, height = x.max() + 4 * radius.max(), y.max() + 4 * radius.max()
    _, i, j, nx, ny = find_pairs(x, y, radius, 0.0, width, height, 0.0, 0, len(x))
    pairs = np.column_stack([i, j]).astype(np.int64)
    image = np.column_stack([nx, ny]).astype(np.int64)
    return Network(position, radius, pairs, image, cell, periodic)
