"""Overlap-free starts: soft discs, a little larger, that push each other apart."""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.neighbours import find_pairs

INFLATION = 1.5e-3  # of the radii, while discs push: what is left of it are the first gaps


@jit
def push_apart(
    x: Floats, y: Floats, radius: Floats, free: Ints, width: float, height: float, most_steps: int
) -> tuple[int, float]:
    """Move discs until none overlap, by FIRE (Bitzek et al., Phys. Rev. Lett. 97 (2006) 170201).

    Parameters
    ----------
    x, y : (N,)
        Positions in an unsheared periodic cell; overwritten.
    radius : (N,)
        Radii to be free of overlap.
    free : (N,)
        0 for discs that stay where they are; they may overlap one another.
    width, height : float
        Cell edges.
    most_steps : int
        When to give up.

    Returns
    -------
    steps : int
    overlap : float
        The largest that is left, in mean diameters of the larger discs that push; the discs
        themselves are free where it is below `INFLATION` / 2.
    """
    n = x.shape[0]
    large = np.empty(n)
    unit = 0.0
    for d in range(n):
        large[d] = radius[d] * (1.0 + INFLATION)
        unit += 2.0 * radius[d] / n
    skin = 0.3 * unit
    vx, vy, fx, fy = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    dt, most_dt, alpha, uphill = 0.1, 0.7, 0.1, 0
    x0, y0 = np.full(n, np.inf), np.full(n, np.inf)
    i = j = nx = ny = np.empty(0, np.int32)
    overlap = np.inf
    for step in range(most_steps):
        moved = 0.0
        for d in range(n):
            moved = max(moved, (x[d] - x0[d]) ** 2 + (y[d] - y0[d]) ** 2)
        if moved > 0.25 * skin * skin:
            for d in range(n):
                x[d] -= np.floor(x[d] / width) * width
                y[d] -= np.floor(y[d] / height) * height
                x0[d], y0[d] = x[d], y[d]
            _, i, j, nx, ny = find_pairs(x, y, large, skin, width, height, 0.0)
        for d in range(n):
            fx[d] = 0.0
            fy[d] = 0.0
        overlap = 0.0
        for c in range(i.shape[0]):
            a, b = i[c], j[c]
            if not free[a] and not free[b]:
                continue
            dx = x[b] - x[a] + nx[c] * width
            dy = y[b] - y[a] + ny[c] * height
            reach = large[a] + large[b]
            if dx * dx + dy * dy >= reach * reach:
                continue
            distance = np.sqrt(dx * dx + dy * dy)
            depth = reach - distance
            overlap = max(overlap, depth / unit)
            depth /= distance + 1e-12 * unit
            fx[a] -= depth * dx
            fy[a] -= depth * dy
            fx[b] += depth * dx
            fy[b] += depth * dy
        if overlap < 0.4 * INFLATION:
            return step, overlap
        power, speed, force = 0.0, 0.0, 0.0
        for d in range(n):
            if not free[d]:
                fx[d] = 0.0
                fy[d] = 0.0
            power += fx[d] * vx[d] + fy[d] * vy[d]
            speed += vx[d] * vx[d] + vy[d] * vy[d]
            force += fx[d] * fx[d] + fy[d] * fy[d]
        if power > 0.0:
            uphill += 1
            turn = alpha * np.sqrt(speed / force)
            for d in range(n):
                vx[d] = (1.0 - alpha) * vx[d] + turn * fx[d]
                vy[d] = (1.0 - alpha) * vy[d] + turn * fy[d]
            if uphill > 5:
                dt = min(1.1 * dt, most_dt)
                alpha *= 0.99
        else:
            uphill = 0
            dt *= 0.5
            alpha = 0.1
            for d in range(n):
                vx[d] = 0.0
                vy[d] = 0.0
        for d in range(n):
            vx[d] += dt * fx[d]
            vy[d] += dt * fy[d]
            x[d] += dt * vx[d]
            y[d] += dt * vy[d]
    return most_steps, overlap
