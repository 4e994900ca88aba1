"""One prepared packing, run as often as wanted and stepped in any way: what accuracy asks for."""

from fractions import Fraction
from typing import Any, TypeVar, get_args

import numpy as np

from shear_sim.models.microgel.parameters import Integrator, MicrogelPoint
from shear_sim.models.microgel.preparation import make_start
from shear_sim.models.microgel.simulation import MicrogelSimulation, kernels_of, make_clock, refined
from shear_sim.models.microgel.state import STEADY, Clock, Discs, Pairs
from shear_sim.streams import Streams

State = TypeVar("State", Discs, Pairs)


class PreparedMicrogel:
    """See :class:`shear_sim.models.interface.Prepared`."""

    schemes: tuple[str, ...] = get_args(Integrator.model_fields["scheme"].annotation)

    def __init__(self, point: MicrogelPoint, streams: Streams) -> None:
        self.point = point
        self.scheme: str = point.integrator.scheme
        self._start = make_start(point, streams)
        steps = point.steps_per_period
        self._clock = make_clock(point.shear, self._start.period, steps, point.record.every)
        rest = round(point.shear.post_periods * steps)
        every = self._clock.every
        self._last = -(-(self._clock.end + rest) // every) * every  # ends with a record
        directions = streams.generator("twin").uniform(0, 2 * np.pi, len(self._start.discs.x))
        self._directions = np.cos(directions), np.sin(directions)

    @property
    def mean_radius(self) -> float:
        """⟨r⟩ [m]."""
        return float(self._start.discs.radius.mean())

    def allows(self, factor: Fraction) -> bool:
        """Tell whether the protocol has whole steps when it has ``factor`` times as many."""
        clock = self._clock
        every = clock.every * factor
        counts = (clock.begin, clock.end, self._last, clock.per_period)
        return all((count * factor).denominator == 1 for count in counts) and (
            every.denominator == 1 or every.numerator == 1
        )

    def start(
        self,
        scheme: str | None = None,
        *,
        factor: Fraction = Fraction(1),
        displacement: float = 0.0,
        energy: bool = False,
    ) -> MicrogelSimulation:
        """Return a simulation that starts from the prepared packing."""
        if not self.allows(factor):
            msg = f"{factor} times {self._clock.per_period} steps per period are not whole steps"
            raise ValueError(msg)
        clock = _scaled(self._clock, factor, self._start.period)
        rest = (self._last - self._clock.end) / self._clock.per_period
        point = self.point
        integrator = point.integrator.model_copy(
            update={
                "scheme": scheme or point.integrator.scheme,
                "steps_per_period": clock.per_period,
            }
        )
        point = point.model_copy(
            update={
                "integrator": integrator,
                "shear": point.shear.model_copy(update={"post_periods": rest}),
                "record": point.record.model_copy(update={"energy": energy}),
            }
        )
        discs = _copied(self._start.discs)
        links, contacts = _copied(self._start.links), _copied(self._start.contacts)
        if displacement:
            free = discs.plate == 0
            for position, direction in zip((discs.x, discs.y), self._directions, strict=True):
                position[free] += displacement * self.mean_radius * direction[free]
        return MicrogelSimulation(
            point, kernels_of(point), discs, links, contacts,
            refined(self._start.constants, max(1.0, self.point.refinement * float(factor))),
            clock, self._start.preparation,
        )  # fmt: skip

    def distance(self, one: MicrogelSimulation, other: MicrogelSimulation) -> float:
        """Return the root mean square distance of the discs of two runs, in mean radii."""
        strain = one.columns()["strain"][-1]
        dx, dy = one.discs.x - other.discs.x, one.discs.y - other.discs.y
        constants = self._start.constants
        if constants.periodic:  # the nearest image, in the sheared cell
            rows = np.rint(dy / constants.height)
            dx -= rows * strain * constants.height
            dy -= rows * constants.height
            dx -= np.rint(dx / constants.width) * constants.width
        return float(np.sqrt(np.mean(dx**2 + dy**2))) / self.mean_radius

    def energy_residual(self, simulation: MicrogelSimulation) -> float:
        """Return the largest error of the energy balance over all that is lost."""
        return energy_residual(simulation.columns())


def energy_residual(columns: dict[str, Any]) -> float:
    """Return max |put in − lost − gained| / lost at the end, from the columns of record.energy.

    Not a number where nothing is lost.
    """
    lost = sum(values for name, values in columns.items() if name.startswith("lost"))
    energy = columns["kinetic_energy"] + columns["elastic_energy"]
    residual = np.abs(columns["energy_put_in"] - lost - (energy - energy[0])).max()
    return float(residual / lost[-1]) if lost[-1] > 0 else float("nan")


def _copied(state: State) -> State:
    return type(state)(*(array.copy() for array in state))  # type: ignore[arg-type]


def _scaled(clock: Clock, factor: Fraction, period: float) -> Clock:
    """Return the same protocol in ``factor`` times as many steps."""
    steps = int(clock.per_period * factor)
    amplitude = clock.amplitude / float(factor) if clock.kind == STEADY else clock.amplitude
    return Clock(
        step=period / steps,
        begin=int(clock.begin * factor),
        end=int(clock.end * factor),
        kind=clock.kind,
        per_period=steps,
        amplitude=amplitude,
        every=max(1, int(clock.every * factor)),
    )
