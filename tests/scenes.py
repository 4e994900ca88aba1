"""Small scenes for the physics tests: a few discs placed by hand, or a small packing.

All numbers of a hand-made scene are in one consistent system of units, whichever it is.
"""

from types import SimpleNamespace

import numpy as np

from shear_sim.models.microgel import derive, laws
from shear_sim.models.microgel.parameters import (
    Damping,
    Integrator,
    Links,
    Microgel,
    MicrogelPoint,
    Record,
)
from shear_sim.models.microgel.preparation import glue, prepare
from shear_sim.models.microgel.simulation import (
    STEP_ENERGY,
    MicrogelSimulation,
    kernels_for,
    make_discs,
    make_pairs,
)
from shear_sim.models.microgel.state import STEADY, Clock, Constants
from shear_sim.packing import Cell, Packing
from shear_sim.protocol import OscillatoryShear, SteadyShear
from shear_sim.streams import Streams

COMPONENTS = ("xx", "xy", "yx", "yy")
LOOSE = Links(cut="none")
UNDAMPED = Damping(decay=1.0)


def constants(**changes):
    """Constants of a linear law without any dashpot or damping, but for ``changes``.

    ``k``, ``kt``, ``eta``, ``etat`` set contacts and links alike.
    """
    for name in ("k", "kt", "eta", "etat"):
        if name in changes:
            changes.setdefault(f"link_{name}", changes[name])
    if "step_normal" in changes:
        changes.setdefault("step_energy", STEP_ENERGY * changes["step_normal"])
    values = {
        "width": 500.0, "height": 500.0, "periodic": False,
        "k": 0.0, "kt": 0.0, "eta": 0.0, "etat": 0.0,
        "link_k": 0.0, "link_kt": 0.0, "link_eta": 0.0, "link_etat": 0.0,
        "friction": 0.0, "law": (0.0, 1.0, 1.0, 1.0), "may_pull": True, "stretched_dashpot": True,
        "plates": False, "contact_arms_in_velocity": True, "contact_arms_in_torque": True,
        "damping": 0.0, "spin_damping": 0.0, "spin_target": 0.0, "affine": True, "skin": 12.0,
        "step_normal": 1e9, "step_energy": 1e9, "step_normal_dashpot": 1e9, "step_rolling": 1e9,
        "step_rolling_dashpot": 1e9, "step_approach": 0.2, "step_strain": 0.03,
    }  # fmt: skip
    assert changes.keys() <= values.keys(), changes.keys() - values.keys()
    return Constants(**(values | changes))


def scene(
    position,
    radius,
    *,
    step,
    steps,
    velocity=None,
    spin=None,
    mass=None,
    inertia=None,
    links=(),
    images=None,
    strain_rate=0.0,
    plates=False,
    tangential=True,
    law=laws.divergent,
    euler=False,
    reset=False,
    **changes,
):
    """Return a simulation of a few discs in steady shear (or at rest), a record at every step."""
    c = constants(plates=plates, **changes)
    radius = np.broadcast_to(np.asarray(radius, float), len(position))
    mass = np.ones(len(radius)) if mass is None else np.asarray(mass, float)
    discs = make_discs(
        np.asarray(position, float), radius, mass=mass, inertia=inertia, velocity=velocity,
        spin=spin,
    )  # fmt: skip
    if plates:
        glue(discs, c.height)
    links = np.asarray(links, np.int64).reshape(-1, 2)
    images = np.zeros_like(links) if images is None else np.asarray(images, np.int64)
    clock = Clock(float(step), 0, steps, STEADY, 100, float(strain_rate * step), 1)
    point = MicrogelPoint(
        shear=SteadyShear(kind="steady", relative_rate=1.0, strain=100.0, post_periods=0),
        integrator=Integrator(scheme="semi_implicit_euler" if euler else "velocity_verlet"),
    )
    return MicrogelSimulation(
        point, kernels_for(law, tangential, reset=reset), discs, make_pairs(links, images),
        make_pairs(), c, clock, {},
    )  # fmt: skip


def packing_point(
    *, discs=40, links=LOOSE, shear=None, cell=None, packing=None, steps_per_period=None, every=1,
    columns=None, **model,
):  # fmt: skip
    """Return the point of a small packing; ``model`` are fields of Microgel."""
    return MicrogelPoint(
        cell=cell or Cell(),
        packing=Packing(discs=discs, **(packing or {})),
        model=Microgel(links=links, **model),
        shear=shear or OscillatoryShear(pre_periods=0.1, periods=1, post_periods=0.1),
        integrator=Integrator(steps_per_period=steps_per_period),
        record=Record(every=every, columns=columns),
    )


def steady(strain, rate=0.02, **more):
    """Return steady shear without rests."""
    more = {"pre_periods": 0, "post_periods": 0} | more
    return SteadyShear(kind="steady", relative_rate=rate, strain=strain, **more)


def prepared(point, seed=0):
    return prepare(point, Streams(seed, 0))


def finish(simulation):
    """Run to the end of the protocol and return all columns, stored and derived."""
    simulation.advance(simulation.rows)
    columns = simulation.columns()
    return columns | derive(columns)


def tensor(columns, name, row=-1):
    """Return one tensor (2, 2) of a record."""
    return np.array([[columns[f"{name}_{a}{b}"][row] for b in "xy"] for a in "xy"])


def linear_momentum(simulation):
    """Return Σ m c (2,); the lab momentum where there is no flow."""
    d = simulation.discs
    return np.array([(d.mass * d.cx).sum(), (d.mass * d.cy).sum()])


def angular_momentum(simulation):
    """Return Σ m (x v − y u) + I ω about the origin, where there is no flow."""
    d = simulation.discs
    return (d.mass * (d.x * d.cy - d.y * d.cx) + d.inertia * d.spin).sum()


def evaluate(simulation, strain=0.0, rate=0.0):
    """Evaluate forces at this instant, without moving springs; return forces (N, 2) and torques."""
    s, w = simulation, simulation.work
    w.px[:], w.py[:], w.pspin[:] = s.discs.cx, s.discs.cy, s.discs.spin
    s.kernels.contact_forces(s.discs, w, s.links, s.contacts, s.constants, strain, rate, 0.0, True)
    return SimpleNamespace(
        force=np.column_stack([w.fx, w.fy]), torque=w.torque.copy(), sums=w.tensors.copy()
    )
