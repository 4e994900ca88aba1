"""Forces, torques and tensors of stored instants of the historical program, particleShear 1.0.2.

The rules are the historical ones (`reset`, `particleshear` arms, no tangential dashpot in stretched
links, the state's own fixed discs); positions, velocities and springs are the stored ones. See
tests/data/states/README.md for how the data were made. Units there: µm, s, mg per metre of depth.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from shear_sim.models.microgel import derive, laws, motion
from shear_sim.models.microgel.simulation import kernels_for, make_discs, make_pairs, make_work
from shear_sim.models.microgel.state import ROW, SPRING, SPRING_BACK, Constants, set_column

STATES = sorted((Path(__file__).parents[1] / "data" / "states").glob("*.npz"))
PERMANENT = 2
TO_PASCAL = 1e-6  # (mg µm/s² per m) × µm / µm²


def constants_of(meta):
    """Contacts have k; links have k × permanent_ratio."""
    central, tangential = meta["permanent_ratio_central"], meta["permanent_ratio_tangential"]
    keep = meta["keep_viscosity_coefficients_constant"]
    return Constants(
        width=float(meta["size_x"]), height=float(meta["size_y"]), periodic=True,
        k=float(meta["k"]), kt=float(meta["k_t"]), eta=float(meta["nu"]), etat=float(meta["nu_t"]),
        link_k=float(meta["k"] * central), link_kt=float(meta["k_t"] * tangential),
        link_eta=float(meta["nu"] * (1 if keep else central)),
        link_etat=float(meta["nu_t"] * (1 if keep else tangential)),
        friction=float(meta["mu"]),
        law=(float(meta["central_repulsion_coefficient"]), *map(float, meta["plateau"])),
        may_pull=True, stretched_dashpot=False, plates=False,
        contact_arms_in_velocity=False, contact_arms_in_torque=True,
        damping=0.0, spin_damping=0.0, spin_target=0.0, affine=True, skin=1.0,
        step_normal=1.0, step_energy=1.0, step_normal_dashpot=1.0, step_rolling=1.0,
        step_rolling_dashpot=1.0, step_approach=1.0, step_strain=1.0,
    )  # fmt: skip


def evaluate(path, k):
    """Return our row of tensors, forces (N, 3) and the discs at the instant of record k."""
    z = np.load(path)
    meta = json.loads(str(z["meta_json"]))
    constants = constants_of(meta)
    which = int(np.flatnonzero(z["full_steps"] == k)[0])
    x, y, vx, vy, omega, _ = z["X"][which].T
    radius, mass, inertia = z["sphere"][:, :3].T
    rate_before = z["rate"][k - 1] if k else meta["shear_rate0"]
    rate, strain = float(z["rate"][k]), float(z["shear_at_eval"][k])
    height = constants.height
    discs = make_discs(
        np.column_stack([x, y]), radius, mass=mass, inertia=inertia,
        velocity=np.column_stack([vx - rate_before * (y - height / 2), vy]),
        spin=omega + rate_before / 2,
    )  # fmt: skip
    if meta["applyingShear"]:
        fixed = (radius >= y) | (y >= height - radius)
        discs.plate[fixed] = np.where(y[fixed] > height / 2, 1, -1)

    stored = {}  # (i, j) -> (type, elongation owned by i)
    ptr, idx = z[f"nb{k}_ptr"], z[f"nb{k}_idx"]
    for i in range(len(x)):
        for e in range(ptr[i], ptr[i + 1]):
            stored[i, int(idx[e])] = (int(z[f"nb{k}_type"][e]), float(z[f"nb{k}_fric"][e]))
    linked = np.array([p for p, (t, _) in stored.items() if t == PERMANENT and p[0] < p[1]], int)
    linked = linked.reshape(-1, 2)
    work = make_work(len(x))
    links = make_pairs(linked, nearest_image(discs, linked, strain, constants))
    contacts = motion.renew_contacts(discs, work, links, make_pairs(), constants, strain)
    for pairs in (links, contacts):
        ends = list(zip(pairs.i, pairs.j, strict=True))
        set_column(pairs, SPRING, [stored.get((i, j), (0, 0.0))[1] for i, j in ends])
        set_column(pairs, SPRING_BACK, [stored.get((j, i), (0, 0.0))[1] for i, j in ends])
    work.px[:], work.py[:], work.pspin[:] = discs.cx, discs.cy, discs.spin
    law = laws.plateau if meta["law"] == "plateau" else laws.divergent
    kernels = kernels_for(law, True, reset=True)
    kernels.contact_forces(discs, work, links, contacts, constants, strain, rate, 0.0, True)
    row = np.zeros(len(ROW))
    if meta["calls_setShearRate"]:
        motion.finish_row(discs, work, constants, rate, row)
    else:  # the evaluator of the two-disc scenarios sees all discs, and lab velocities (rate 0)
        lab = discs._replace(cx=vx.copy(), spin=omega.copy(), plate=np.zeros_like(discs.plate))
        motion.finish_row(lab, work, constants, 0.0, row)
    tensors = derive({n: np.array([v * TO_PASCAL]) for n, v in zip(ROW, row, strict=True)})
    tensors |= {
        n: np.array([v * TO_PASCAL]) for n, v in zip(ROW, row, strict=True) if "_" in n
    } | tensors
    return z, meta, tensors, np.column_stack([work.fx, work.fy, work.torque]), discs


def nearest_image(discs, pairs, strain, constants):
    """Image of j nearest to i, y first (only valid while nothing is stretched over half a cell)."""
    i, j = pairs.T
    ny = -np.floor((discs.y[j] - discs.y[i]) / constants.height + 0.5)
    dx = discs.x[j] - discs.x[i] + ny * strain * constants.height
    return np.column_stack([-np.floor(dx / constants.width + 0.5), ny]).astype(int)


def tensor(tensors, name):
    return np.array([[tensors[f"{name}_{a}{b}"][0] for b in "xy"] for a in "xy"])


def instants():
    return [
        pytest.param(path, k, id=f"{path.stem}-{k}")
        for path in STATES
        for k in (0, 100, 200, 300)
        if f"nb{k}_ptr" in np.load(path).files and k < len(np.load(path)["rate"])
    ]


def test_all_states_are_here():
    assert len(STATES) == 16


@pytest.mark.parametrize("path", STATES, ids=lambda p: p.stem)
def test_forces_and_torques(path):
    z, _, _, forces, discs = evaluate(path, 0)
    free = discs.plate == 0
    # F_eval of the state after one step was evaluated at the start of that step.
    theirs = z["F_eval"][int(np.flatnonzero(z["full_steps"] == 1)[0])]
    for ours, reference in (
        (forces[free, :2], theirs[free, :2]),
        (forces[free, 2], theirs[free, 2]),
    ):
        assert np.abs(ours - reference).max() <= 1e-11 * np.abs(reference).max()


OURS = {
    "LW": "love_weber",
    "with_external_forces": "external",
    "linear_acceleration": "linear_acceleration",
    "unbalanced_forces": "unbalanced_force",
    "internal_torque": "internal_torque",
    "spin_kinetic_energy": "centrifugal",
    "overall": "overall",
    "linear_acceleration_otsuki": "peculiar",
    "unbalanced_torque": "torque",
}


@pytest.mark.parametrize(("path", "k"), instants())
def test_tensors(path, k):
    z, meta, tensors, _, discs = evaluate(path, k)
    theirs = dict(zip(z["tensor_names"].tolist(), z["tensors"][k], strict=True))
    largest = max(np.abs(t).max() for t in theirs.values())
    fixed, area = discs.plate != 0, meta["size_x"] * meta["size_y"]
    for name, reference in theirs.items():
        ours = tensor(tensors, OURS[name])
        if name == "linear_acceleration_otsuki":
            # The document adds momentum flux to the pressure; the program subtracts it.
            ours = -ours
        if name == "unbalanced_torque" and fixed.any() and meta["mid_list"] == "movable":
            if k > 0:
                continue  # torques on fixed discs are stored for the first instant only
            # The document sums over the discs of the system, the program over fixed ones too.
            torque = z["F_eval"][int(np.flatnonzero(z["full_steps"] == 1)[0])][fixed, 2].sum()
            ours = ours + 0.5 * torque * TO_PASCAL / area * np.array([[0, -1], [1, 0]])
        scale = max(np.abs(reference).max(), 1e-3 * largest)
        assert np.abs(ours - reference).max() <= 1e-11 * scale, name
