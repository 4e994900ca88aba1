"""A microgel simulation: prepared once, then asked for its records."""

import math
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.compiled import variant
from shear_sim.models.interface import Columns, SimulationError, Snapshot
from shear_sim.models.microgel import laws, motion, snapshots
from shear_sim.models.microgel.parameters import (
    Microgel,
    MicrogelPoint,
)
from shear_sim.models.microgel.state import (
    BLOCK_ROWS,
    ENERGIES,
    LANES,
    MOST_PIECES,
    NX,
    NY,
    OSCILLATION,
    PERIOD,
    PHASE,
    ROW,
    RUNNING,
    SPRING,
    SPRING_BACK,
    STATE,
    STEADY,
    STICK,
    SUMS,
    TOO_STIFF,
    Clock,
    Constants,
    Discs,
    Pairs,
    PairState,
    Work,
    column,
    listed,
    places_of,
    set_column,
)
from shear_sim.models.microgel.strips import edges_of, in_strips, in_threads
from shear_sim.protocol import OscillatoryShear, Shear, snapshot_rows
from shear_sim.quads import zeros_in_lines
from shear_sim.threads import new_meeting

FloatArray = NDArray[np.float64]

SKIN = 0.6  # of the mean radius: neighbour lists reach this much beyond contact
STEP_ENERGY = 0.5  # longest substep, of the stable one of springs alone: analysis/default_steps.py
CORE = 0.1  # distance over contact distance: who comes closer may pass through


@cache
def kernels_for(
    law: laws.Law, tangential: bool, tally: bool = False, reset: bool = False
) -> ModuleType:
    """Return the kernels compiled for a contact law, with what a scene needs and no more."""
    key = f"{law.__name__}-{tangential}-{tally}-{reset}"
    module = variant("shear_sim.models.microgel.kernels", key)
    vars(module).update(law=law, TANGENTIAL=tangential, TALLY=tally, RESET=reset)
    return module


def kernels_of(point: MicrogelPoint) -> ModuleType:
    """Return the kernels of a point.

    Raises
    ------
    SimulationError
        If the user's contact law does not work.
    """
    model = point.model
    return kernels_for(
        contact_law(model), needs_tangential(model), point.record.energy, model.sliding == "reset"
    )


def contact_law(model: Microgel) -> laws.Law:
    """Return the contact law of a study; a user's law that does not work fails its jobs only."""
    try:
        return laws.law_of(model.contact_law)[0]
    except ValueError as error:
        msg = f"contact law {getattr(model.contact_law, 'file', None)}: {error}"
        raise SimulationError(msg) from None


def needs_tangential(model: Microgel) -> bool:
    """Tell whether anything turns: friction in contacts, or links."""
    return model.friction > 0 or model.links.cut != "none"


def make_discs(
    position: FloatArray,
    radius: FloatArray,
    *,
    density: float | None = None,
    mass: FloatArray | None = None,
    inertia: FloatArray | None = None,
    velocity: FloatArray | None = None,
    spin: FloatArray | None = None,
) -> Discs:
    """Return the state of N discs.

    Parameters
    ----------
    position, radius : (N, 2), (N,)
        [m].
    density : float
        ρ [kg/m³] for m = πρr² and I = mr²/2 where ``mass`` [kg/m] and ``inertia`` are not given.
    velocity, spin : (N, 2), (N,)
        Peculiar velocity [m/s] and spin ω + γ̇/2 [1/s]; default 0.
    """
    n = len(radius)
    if mass is None:
        if density is None:
            msg = "discs need a density or masses"
            raise ValueError(msg)
        mass = math.pi * density * radius**2
    inertia = 0.5 * mass * radius**2 if inertia is None else inertia
    velocity = np.zeros((n, 2)) if velocity is None else velocity
    x, y, cx, cy, s, r, m, i = (
        np.array(a, dtype=float)
        for a in (
            position[:, 0], position[:, 1], velocity[:, 0], velocity[:, 1],
            np.zeros(n) if spin is None else spin, radius, mass, inertia,
        )
    )  # fmt: skip
    return Discs(x, y, cx, cy, s, r, m, i, np.zeros(n))


def make_work(n: int) -> Work:
    """Return the work arrays for N discs."""

    def per_disc() -> FloatArray:
        return zeros_in_lines(n)

    edges = edges_of(n)
    return Work(
        thread=0, threads=1, meeting=new_meeting(), edges=edges, lower=0, upper=len(edges) - 1,
        begin=np.uint64(0), end=np.uint64(n), extremes=np.zeros((1, 8)),
        pair_sums=np.zeros((len(edges) - 1, SUMS)), disc_sums=np.zeros((len(edges) - 1, SUMS)),
        px=per_disc(), py=per_disc(), pspin=per_disc(),
        fx=per_disc(), fy=per_disc(), torque=per_disc(),
        ax=per_disc(), ay=per_disc(), aspin=per_disc(),
        turn=per_disc(), disc_rows=zeros_in_lines(8 * n), force_rows=zeros_in_lines(4 * n),
        x0=per_disc(), y0=per_disc(),
        wx=np.zeros(n, np.int32), wy=np.zeros(n, np.int32), lx=per_disc(), ly=per_disc(),
        strain0=np.zeros(1), largest=np.zeros(1), turns=np.zeros(1, np.int32),
        block=zeros_in_lines(BLOCK_ROWS * LANES, PERIOD, PHASE),
        closest=np.array([1.0, 1.0, 0.0, 1.0]), stopped=np.zeros(2),
        tensors=np.zeros(SUMS), totals=np.zeros(SUMS), check=np.zeros(1),
        stored=np.zeros(1), power=np.zeros(7), energy=np.zeros(6),
    )  # fmt: skip


def make_pairs(
    pairs: NDArray[np.int64] | None = None,
    image: NDArray[np.int64] | None = None,
    spring: FloatArray | float = 0.0,
    spring_back: FloatArray | float = 0.0,
) -> Pairs:
    """Return pairs (P, 2) with the images (P, 2) of their second discs and their springs [m].

    They are links, or contacts that have touched before.
    """
    pairs = np.zeros((0, 2), np.int64) if pairs is None else pairs
    image = np.zeros_like(pairs) if image is None else image
    ordered = np.sort(pairs, axis=1)
    sign = np.where(pairs[:, 0] > pairs[:, 1], -1, 1)  # the disc of lower number comes first
    new = motion.empty_pairs(len(pairs))
    new.i[:], new.j[:] = ordered.T
    set_column(new, NX, image[:, 0] * sign)
    set_column(new, NY, image[:, 1] * sign)
    set_column(new, SPRING, spring)
    set_column(new, SPRING_BACK, spring_back)
    set_column(new, STATE, STICK)
    return new


def take_pairs(pairs: Pairs, chosen: NDArray[np.bool_]) -> Pairs:
    """Return the ``chosen`` (P,) of ``pairs`` with their springs."""
    pair = np.zeros(len(pairs.i), np.bool_)
    pair[places_of(pairs)] = True
    chosen = chosen & pair
    ends = np.column_stack([pairs.i, pairs.j]).astype(np.int64)
    image = np.column_stack([column(pairs, NX), column(pairs, NY)]).astype(np.int64)
    springs = column(pairs, SPRING), column(pairs, SPRING_BACK)
    return make_pairs(ends[chosen], image[chosen], *(spring[chosen] for spring in springs))


def time_scale(model: Microgel, mass: FloatArray) -> tuple[float, float]:
    """Return the spring constant k = πE/8 [N/m²] (S1-8) and τ = √(⟨m⟩/k) [s]."""
    k = math.pi * model.young_modulus / 8
    return k, math.sqrt(mass.mean() / k)


def make_constants(
    point: MicrogelPoint, discs: Discs, width: float, height: float, period: float
) -> Constants:
    """Return the constants of a run from the physical parameters (manual, part 1, section 5)."""
    model = point.model
    k, _ = time_scale(model, discs.mass)
    eta = model.relative_viscosity * math.sqrt(discs.mass.mean() * k)
    ratio = model.tangential_ratio

    def springs(normal: float, tangential: float) -> tuple[float, float, float, float]:
        viscous = (normal, tangential) if model.scale_viscosity else (1.0, 1.0)
        return k * normal, k * ratio * tangential, eta * viscous[0], eta * ratio * viscous[1]

    contact = springs(model.contacts.normal_factor, model.contacts.tangential_factor)
    link = springs(model.links.normal_factor, model.links.tangential_factor)
    p = laws.law_parameters(model.contact_law)
    damping = -math.log(model.damping.decay) / period
    # The fastest vibrations, of six contacts on the lightest discs: in a crystal ω² = 6 k/m and
    # γ = 6 η/m + 2 η_T/m; as r²/I = 2/m, rolling has 24 k_T/m and 24 η_T/m. In a mixture half of
    # each is due to neighbours, which are heavier. Nominal arms do not shorten as contacts get
    # more numerous: nine of them at a packing fraction of 2.
    k_n, k_t, eta_n, eta_t = (max(both) for both in zip(contact, link, strict=True))
    light = float(discs.mass.min())
    six = 3 * (1 + float(np.sqrt(light / discs.mass).mean())) / light
    rolling = (6 if model.lever_arms == "otsuki2017" else 4) * six
    return Constants(
        width=float(width),
        height=float(height),
        periodic=point.cell.boundary != "open",
        plates=point.cell.boundary == "plates",
        k=contact[0], kt=contact[1], eta=contact[2], etat=contact[3],
        link_k=link[0], link_kt=link[1], link_eta=link[2], link_etat=link[3],
        friction=float(model.friction),
        law=p,
        may_pull=model.dashpot == "attractive",
        stretched_dashpot=model.links.stretched_tangential_dashpot,
        contact_arms_in_velocity=model.lever_arms == "conjugate",
        contact_arms_in_torque=model.lever_arms != "otsuki2017",
        damping=damping,
        spin_damping=0.0 if model.damping.spin == "none" else damping,
        spin_target=0.5 if model.damping.spin == "zero" else 0.0,
        affine=model.drive == "affine",
        skin=SKIN * float(discs.radius.mean()),
        step_normal=2 / math.sqrt(six * k_n),
        step_energy=STEP_ENERGY * 2 / math.sqrt(six * k_n),
        step_normal_dashpot=_inverse(six * (eta_n + eta_t / 3)),
        step_rolling=2 * _inverse(math.sqrt(rolling * k_t)),
        step_rolling_dashpot=_inverse(rolling * eta_t),
        step_approach=0.2,
        step_strain=0.03,
    )  # fmt: skip


def refined(constants: Constants, factor: float) -> Constants:
    """Return the constants with the longest substeps divided by ``factor``."""
    limits = [name for name in Constants._fields if name.startswith("step_")]
    return constants._replace(**{name: getattr(constants, name) / factor for name in limits})


def _inverse(rate: float) -> float:
    return 1 / rate if rate else math.inf


def make_clock(shear: Shear, period: float, steps: int, every: int) -> Clock:
    """Return the protocol in whole steps."""
    begin = round(shear.pre_periods * steps)
    end = begin + max(1, round(shear.periods * steps))
    step = period / steps
    if isinstance(shear, OscillatoryShear):
        kind, amplitude = OSCILLATION, shear.strain_amplitude
    else:
        # The rate is exact; the strain reached is that of whole steps.
        kind, amplitude = STEADY, shear.relative_rate / (shear.relative_frequency * steps)
    return Clock(step, begin, end, kind, steps, float(amplitude), every)


def last_step(clock: Clock, shear: Shear) -> int:
    """Return the number of steps of a run, whose last rest ends with a record."""
    steps = clock.end + round(shear.post_periods * clock.per_period)
    return -(-steps // clock.every) * clock.every


class MicrogelSimulation:
    """One prepared simulation; see :class:`shear_sim.models.interface.Simulation`."""

    threads = 1

    def __init__(
        self,
        point: MicrogelPoint,
        kernels: ModuleType,
        discs: Discs,
        links: Pairs,
        contacts: Pairs,
        constants: Constants,
        clock: Clock,
        preparation: dict[str, Any],
    ) -> None:
        self.point, self.kernels = point, kernels
        glued = (discs.plate[links.i] != 0) & (discs.plate[links.j] != 0)
        links = take_pairs(links, ~glued)  # links of the outside world
        self.discs = discs
        self.constants, self.clock = constants, clock
        self.preparation = preparation
        self.work = make_work(len(discs.x))
        self.links = in_strips(links, self.work.edges)
        self.contacts = contacts
        if len(contacts.strips) < len(self.links.strips):  # given, not listed by a kernel
            self.contacts = in_strips(contacts, self.work.edges)
        self.steps = last_step(clock, point.shear)
        self.done = 0
        self.substeps = 0
        self.names = ROW + ENERGIES if point.record.energy else ROW
        self._table = np.empty((self.rows, len(self.names)))
        self.snapshots: list[Snapshot] = []
        self._kept = self._snapshot_rows()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "kernels"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, kernels=kernels_of(state["point"]))

    @property
    def rows(self) -> int:
        """Number of records of the whole protocol."""
        return self.steps // self.clock.every + 1

    @property
    def pairs(self) -> PairState:
        """State of all links, then of all listed contacts."""
        links, contacts = listed(self.links), listed(self.contacts)
        fields = PairState._fields
        return PairState(
            *(np.concatenate([getattr(links, f), getattr(contacts, f)]) for f in fields)
        )

    def _snapshot_rows(self) -> tuple[int, ...]:
        """Return the records of which a snapshot is kept."""
        clock, wanted = self.clock, self.point.record.snapshots
        if wanted is None:
            return ()
        unit = clock.per_period if clock.kind == OSCILLATION else 1 / abs(clock.amplitude)
        steps = np.arange(self.rows) * clock.every - clock.begin
        return snapshot_rows(wanted, steps / unit, (clock.end - clock.begin) / unit)

    def advance(self, rows: int) -> None:
        """Make the next records."""
        until = min(self.done + rows, self.rows)
        for row in [row for row in self._kept if self.done <= row < until]:
            self._advance(row + 1)
            _, strain, rate = self._table[row, :3].tolist()
            snapshot = snapshots.take(
                row, strain, rate, self.kernels, self.discs, self.work, self.links, self.contacts,
                self.constants,
            )  # fmt: skip
            self.snapshots.append(snapshot)
        self._advance(until)

    def _advance(self, until: int) -> None:
        if until <= self.done:
            return
        first = (self.done - 1) * self.clock.every  # negative: the first record comes first
        last = (until - 1) * self.clock.every
        rows = self._table[self.done : until]
        euler = self.point.integrator.scheme == "semi_implicit_euler"
        self.contacts, filled, substeps, status = in_threads(
            1 if self.point.record.energy else self.threads,  # the balance is summed pair by pair
            self.work, self.links, self.contacts,
            lambda work, links, contacts: self.kernels.run(
                self.discs, work, links, contacts, self.constants, self.clock, first, last, euler,
                rows if work.thread == 0 else np.empty_like(rows),
            ),
        )  # fmt: skip
        self.done += filled
        self.substeps += substeps
        if status != RUNNING:
            raise SimulationError(self._diagnosis(status))

    def _diagnosis(self, status: int) -> str:
        time, strain = self.work.stopped
        when = f"at t = {time:g} s (strain {strain:.4g})"
        if status == TOO_STIFF:
            return self._too_stiff(when, strain)
        limit = 500.0 * self.constants.width
        bad = np.flatnonzero(~(np.abs(self.discs.x) + np.abs(self.discs.y) < limit))
        what = f"disc {bad[0]} was shot away" if len(bad) else "a stress is no longer finite"
        return f"{what} {when}: raise integrator.steps_per_period = {self.clock.per_period}"

    def _too_stiff(self, when: str, strain: float) -> str:
        """Say what needs substeps that are too short, and what to do."""
        c, d, pairs, clock = self.constants, self.discs, self.pairs, self.clock
        size = 2 * float(d.radius.mean())
        longest = self.kernels.substep(c, self.work, size, motion.peak_rate(clock, clock.kind))
        need = (
            f"substeps of at most {longest:.3g} s {when}, shorter than 1/{MOST_PIECES} of a whole "
            f"step ({clock.step:.3g} s)"
        )
        stretched = self.work.closest[1] ** 2
        if min(c.step_normal_dashpot, c.step_rolling_dashpot / stretched) < 2 * longest:
            return f"the dashpots need {need}: lower model.relative_viscosity"
        dx, dy = d.x[pairs.j] - d.x[pairs.i], d.y[pairs.j] - d.y[pairs.i]
        offset = strain * c.height - self.work.turns[0] * c.width
        distance = np.hypot(
            dx + pairs.nx * c.width + pairs.ny * offset, dy + pairs.ny * c.height
        ) / (d.radius[pairs.i] + d.radius[pairs.j])
        q = int(np.argmin(distance))
        return (
            f"discs {pairs.i[q]} and {pairs.j[q]}, at {distance[q]:.3g} of their contact distance, "
            f"need {need}: a less steep model.contact_law, or less strain"
        )

    def columns(self) -> Columns:
        """Return the stored columns of the records made so far."""
        return {n: self._table[: self.done, c].copy() for c, n in enumerate(self.names)}

    def summary(self) -> dict[str, Any]:
        """Return derived constants, protocol, preparation, self-checks and flags."""
        c, clock, shear = self.constants, self.clock, self.point.shear
        k, tau = time_scale(self.point.model, self.discs.mass)
        period = clock.step * clock.per_period
        protocol: dict[str, Any] = {
            "kind": shear.kind,
            "period": period,
            "steps_per_period": clock.per_period,
            "time_step": clock.step,
            "shear_start": clock.begin * clock.step,
            "shear_end": clock.end * clock.step,
            "end": self.steps * clock.step,
            "periods": (clock.end - clock.begin) / clock.per_period,
        }
        if isinstance(shear, OscillatoryShear):
            protocol["strain_amplitude"] = shear.strain_amplitude
        else:
            protocol["strain"] = clock.amplitude * (clock.end - clock.begin)
            protocol["strain_rate"] = clock.amplitude / clock.step
        area = float(np.pi * (self.discs.radius**2).sum())
        return {
            "derived": {
                "spring_constant": k,
                "time_constant": tau,
                "frequency": 1 / period,
                "normal_viscosity": c.eta,
                "tangential_viscosity": c.etat,
                "mean_mass": float(self.discs.mass.mean()),
                "large_radius": float(self.discs.radius.max()),
                "small_radius": float(self.discs.radius.min()),
                "width": c.width,
                "height": c.height,
                "packing_fraction": area / (c.width * c.height),
                "damping_rate": c.damping,
            },
            "protocol": protocol,
            "preparation": self.preparation,
            "checks": self._checks(),
            "flags": {
                "not_at_rest": not self.preparation.get("at_rest", True),
                "deep_overlap": bool(self.work.closest[3] < CORE),
            },
        }

    def _checks(self) -> dict[str, float | None]:
        """Self-checks of the records: largest relative errors of what must hold exactly."""
        column = self.columns()

        # Of all contacts: the internal one is 0 but for rounding where every one crosses an edge.
        tensor = [np.abs(column[f"periodic_love_weber_{ab}"]) for ab in ("xx", "xy", "yx", "yy")]
        scale = np.max(np.sum(tensor, axis=0))

        def asymmetry(name: str, torque: str) -> float:
            xy = column[f"{name}_xy"] - column[torque]
            yx = column[f"{name}_yx"] + column[torque]
            return float(np.abs(xy - yx).max() / scale) if scale > 0 else 0.0

        d, clock = self.discs, self.clock
        momentum = np.hypot((d.mass * d.cx).sum(), (d.mass * d.cy).sum())
        # Plates, and edges that drive, exchange momentum with the discs.
        kept = self.constants.affine and not (d.plate != 0).any()
        speed = motion.peak_rate(clock, clock.kind) * self.constants.height
        return {
            "asymmetry_periodic": asymmetry("periodic_love_weber", "periodic_torque_yx"),
            "asymmetry_internal": asymmetry("love_weber", "internal_torque_yx"),
            "love_weber_identity": float(self.work.check[0]),
            "closest": float(self.work.closest[3]),
            "momentum": float(momentum / (d.mass.sum() * speed)) if kept else None,
            "substeps": self.substeps,
            "steps": self.steps,
        }
