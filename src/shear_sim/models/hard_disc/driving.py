"""What drives a run: when records are made, and how the drive changes on the way."""

import heapq
import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Drive
from shear_sim.models.hard_disc.flow import Flow
from shear_sim.models.hard_disc.parameters import (
    HardDiscCompression,
    HardDiscOscillatoryShear,
    HardDiscSelfPropulsion,
    HardDiscShear,
    HardDiscSteadyShear,
)
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

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
    if isinstance(shear, HardDiscSelfPropulsion):
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


class SelfPropelled:
    """Every disc has a force of its own, and a new one each time its persistence ends."""

    def __init__(self, section: HardDiscSelfPropulsion, discs: int, streams: Streams) -> None:
        self._section = section
        self._rng = streams.generator("propulsion")
        self.drive = Drive(0.0, 0.0, 0.0, np.array([self._force() for _ in range(discs)]).T.copy())
        self._ends = [(self._persistence(), disc) for disc in range(discs)]
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
        drift[:, disc] = self._force()
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


def make_driving(shear: HardDiscShear, discs: int, streams: Streams) -> Driving:
    """Return what drives a run."""
    if isinstance(shear, HardDiscOscillatoryShear):
        return Reversing(shear.strain_amplitude, discs)
    if isinstance(shear, HardDiscSelfPropulsion):
        return SelfPropelled(shear, discs, streams)
    free = np.zeros((2, discs))
    if isinstance(shear, HardDiscCompression):
        return Constant(Drive(0.0, math.copysign(1.0, shear.compression), 0.0, free))
    if shear.scaled_pressure is None:
        return Constant(Drive(1.0, shear.compression_ratio, 0.0, free))
    return Constant(Drive(1.0, FIRST_COMPRESSION, shear.scaled_pressure, free))
