"""What drives a run: when records are made, and how the drive changes on the way."""

import heapq
import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Drive
from shear_sim.models.hard_disc.flow import Flow
from shear_sim.models.hard_disc.parameters import (
    HardDiscBodyForce,
    HardDiscCompression,
    HardDiscOscillatoryShear,
    HardDiscSelfPropulsion,
    HardDiscShear,
    HardDiscStages,
    HardDiscSteadyShear,
)
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

ROUNDING = 1e-12  # of sums of path
FIRST_COMPRESSION = 10.0  # κ at fixed pressure until the first contact


class Records(NamedTuple):
    """When records are made; arrays of shape (R,)."""

    path: FloatArray
    time: FloatArray  # [s]
    strain: FloatArray
    strain_rate: FloatArray  # [1/s]
    path_rate: FloatArray  # [1/s]: times 1/ξ₀ it is the unit of stress


def make_records(shear: HardDiscShear, rows: int) -> Records:
    """Return ``rows`` records after the first, evenly in time."""
    share = np.linspace(0.0, 1.0, rows + 1)
    none, one = np.zeros(rows + 1), np.ones(rows + 1)
    if isinstance(shear, HardDiscSteadyShear):
        path = shear.strain * share
        rate = shear.strain_rate * one
        return Records(path, path / shear.strain_rate, path, rate, rate)
    if isinstance(shear, HardDiscCompression):
        path = abs(shear.compression) * share
        return Records(path, path / shear.rate, none, none, shear.rate * one)
    if isinstance(shear, HardDiscStages):
        path = shear.length * share
        ends = np.cumsum([0.0, *(stage.length for stage in shear.stages)])
        turns = np.array([float(stage.shear) for stage in shear.stages])
        strain = np.interp(path, ends, np.cumsum([0.0, *(turns * np.diff(ends))]))
        # At an end: the one that ends.
        stage = np.searchsorted(ends[1:-1] * (1.0 + ROUNDING), path, side="left")
        return Records(path, path / shear.rate, strain, shear.rate * turns[stage], shear.rate * one)
    if isinstance(shear, HardDiscSelfPropulsion | HardDiscBodyForce):
        path = shear.duration * share
        return Records(path, path * shear.time_unit, none, none, one / shear.time_unit)
    half_turns = 2 * shear.periods * share  # of the phase; their whole numbers are exact
    amplitude = shear.strain_amplitude
    strain = amplitude * np.sin(math.pi * (half_turns % 2.0))
    rate = 2 * math.pi / shear.period * amplitude * np.cos(math.pi * (half_turns % 2.0))
    turns = np.floor(half_turns + 0.5)
    path = 2 * amplitude * turns + np.where(turns % 2 == 0, 1.0, -1.0) * strain
    time = shear.period * shear.periods * share
    return Records(path, time, strain, rate, np.abs(rate))


def rest(records: Records, begin: float, end: float, shear: float) -> None:
    """Let the strain of ``records`` stand still on the path from ``begin`` to ``end``, in place.

    Parameters
    ----------
    records : Records
    begin, end : float
        Where jammed discs stop, and where their stage ends.
    shear : float
        The shear per path that they do not take part in.
    """
    path = records.path
    records.strain[:] -= shear * np.clip(path - begin, 0.0, end - begin)
    records.strain_rate[(path > begin) & (path <= end * (1.0 + ROUNDING))] = 0.0


class Driving(Protocol):
    """The drive, until it changes."""

    drive: Drive

    @property
    def until(self) -> float:
        """Path of the next change, infinite after the last."""

    def change(self, flow: Flow) -> None:
        """Give ``flow``, which is at ``until``, its next drive."""


class Constant:
    """One drive to the end."""

    until = math.inf

    def __init__(self, drive: Drive) -> None:
        self.drive = drive

    def change(self, flow: Flow) -> None:
        """Nothing changes."""


class Reversing:
    """Shear that turns at ±A."""

    def __init__(self, amplitude: float, discs: int) -> None:
        self.drive = Drive(1.0, 0.0, 0.0, np.zeros((2, discs)))
        self.until = self._amplitude = amplitude
        self._turns = 0

    def change(self, flow: Flow) -> None:
        """Reverse the shear."""
        self._turns += 1
        self.until = self._amplitude * (1 + 2 * self._turns)
        self.drive = self.drive._replace(shear=-self.drive.shear)
        flow.turn(self.drive)


class Staged:
    """Drives one after another."""

    def __init__(self, section: HardDiscStages, discs: int) -> None:
        free = np.zeros((2, discs))
        self._drives = [
            Drive(float(stage.shear), stage.compression, 0.0, free) for stage in section.stages
        ]
        self._ends = np.cumsum([stage.length for stage in section.stages]).tolist()
        self._stage = 0
        self.drive = self._drives[0]

    @property
    def until(self) -> float:
        """Path at which the stage ends; infinite for the last."""
        last = self._stage + 1 == len(self._ends)
        return math.inf if last else float(self._ends[self._stage])

    def change(self, flow: Flow) -> None:
        """Begin the next stage."""
        self._stage += 1
        self.drive = self._drives[self._stage]
        flow.turn(self.drive)


class SelfPropelled:
    """Every disc has a force of its own, and a new one each time its persistence ends."""

    def __init__(
        self, section: HardDiscSelfPropulsion, mobility: FloatArray, streams: Streams
    ) -> None:
        self._section = section
        self._mobility = mobility
        self._rng = streams.generator("propulsion")
        force = np.array([self._force() for _ in mobility]).T.copy()  # rows, as kernels expect
        self.drive = Drive(0.0, 0.0, 0.0, mobility * force)
        self._ends = [(self._persistence(), disc) for disc in range(len(mobility))]
        heapq.heapify(self._ends)

    @property
    def until(self) -> float:
        """Path at which the next disc reorients."""
        return self._ends[0][0]

    def change(self, flow: Flow) -> None:
        """Reorient the disc whose time it is."""
        now, disc = heapq.heappop(self._ends)
        heapq.heappush(self._ends, (now + self._persistence(), disc))
        drift = self.drive.drift.copy()
        drift[:, disc] = self._mobility[disc] * np.array(self._force())
        self.drive = self.drive._replace(drift=drift)
        flow.steer(self.drive)

    def _persistence(self) -> float:
        return float(self._rng.uniform(0, self._section.persistence))

    def _force(self) -> tuple[float, float]:
        """Return a force of mean square 1 in any direction."""
        angle = float(self._rng.uniform(0, 2 * math.pi))
        uniform = self._section.force == "uniform"
        size = float(self._rng.uniform(0, math.sqrt(3))) if uniform else 1.0
        return size * math.cos(angle), size * math.sin(angle)


def weight(section: HardDiscBodyForce, radius: FloatArray) -> FloatArray:
    """Return the body force (2, N), proportional to the areas: 1 on a mean small disc."""
    angle = math.radians(section.inclination)
    return np.array([[math.sin(angle)], [-math.cos(angle)]]) * (2.0 * radius) ** 2


def make_driving(
    shear: HardDiscShear, radius: FloatArray, mobility: FloatArray, streams: Streams
) -> Driving:
    """Return what drives discs (N,) in a run."""
    if isinstance(shear, HardDiscOscillatoryShear):
        return Reversing(shear.strain_amplitude, len(radius))
    if isinstance(shear, HardDiscSelfPropulsion):
        return SelfPropelled(shear, mobility, streams)
    if isinstance(shear, HardDiscBodyForce):
        return Constant(Drive(0.0, 0.0, 0.0, mobility * weight(shear, radius)))
    if isinstance(shear, HardDiscStages):
        return Staged(shear, len(radius))
    free = np.zeros((2, len(radius)))
    if isinstance(shear, HardDiscCompression):
        return Constant(Drive(0.0, math.copysign(1.0, shear.compression), 0.0, free))
    if shear.scaled_pressure is None:
        return Constant(Drive(1.0, shear.compression_ratio, 0.0, free))
    return Constant(Drive(1.0, FIRST_COMPRESSION, shear.scaled_pressure, free))
