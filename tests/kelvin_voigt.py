"""A model that a pencil can check, with every way of failing: σ = G γ + η dγ/dt.

It goes through study files, workers, tables and moduli as a real model does, in microseconds.
Importing it makes it known, also in worker processes, which import it to read their jobs.
"""

import os
import signal
import sys
import time
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from shear_sim import models
from shear_sim.models.interface import Column, Point, SimulationError
from shear_sim.protocol import OscillatoryShear
from shear_sim.schema import NonNegative, Section

PHYSICS_VERSION = 1
THREADS = "one for each strip"
COLUMNS = (
    Column("time", "s", "time"),
    Column("strain", "1", "imposed strain"),
    Column("periodic_overall_xy", "Pa", "stress, compression positive"),
)
MEASURED = ()
DERIVED = (Column("shear_stress", "Pa", "-periodic_overall_xy"),)
STEPS_PER_PERIOD = 200


class KelvinVoigt(Section):
    """A spring and a dashpot side by side."""

    kind: Literal["kelvin_voigt"]
    modulus: Annotated[float, Field(gt=0, description="G [Pa]")] = 100.0
    viscosity: Annotated[float, Field(ge=0, description="η [Pa s]")] = 5.0
    noise: Annotated[NonNegative, Field(description="amplitude of white noise [Pa]")] = 0.0
    seconds: Annotated[NonNegative, Field(description="how long the simulation takes")] = 0.0
    strips: Annotated[int, Field(ge=1, description="that threads could share")] = 1
    compiled: Annotated[bool, Field(description="whether the spring is a kernel of Numba")] = False
    fault: Annotated[
        Literal["none", "physics", "bug", "exit", "kill", "full", "uncompilable"],
        Field(description="how a job ends, unless HEALED is set in the environment"),
    ] = "none"


class KelvinVoigtPoint(Point):
    """One spring and dashpot."""

    model: KelvinVoigt
    shear: OscillatoryShear = OscillatoryShear()

    @property
    def kind(self):
        return self.model.kind


POINT = KelvinVoigtPoint


class _Simulation:
    snapshots = ()

    def __init__(self, point, streams):
        self.point, self.shear = point, point.shear
        self.period = 1.0 / point.shear.relative_frequency  # with τ = 1 s
        total = self.shear.pre_periods + self.shear.periods + self.shear.post_periods
        self.rows, self.done = round(total * STEPS_PER_PERIOD) + 1, 0
        self.noise = streams.generator("noise").normal(size=self.rows)

    def advance(self, rows):
        model = self.point.model
        while Path(os.environ.get("HELD_BY", "")).is_file():  # a test lets its jobs go
            time.sleep(0.05)
        time.sleep(model.seconds * min(rows, self.rows - self.done) / self.rows)
        self.done = min(self.rows, self.done + rows)
        if self.done == self.rows and "HEALED" not in os.environ:
            fail(model.fault)

    def columns(self):
        time = np.arange(self.done) * (self.period / STEPS_PER_PERIOD)
        omega = 2 * np.pi / self.period
        start, end = self.shear.pre_periods, self.shear.pre_periods + self.shear.periods
        phase = time / self.period
        sheared = (phase >= start) & (phase <= end)
        angle = np.where(sheared, 2 * np.pi * (phase - start), 0.0)
        amplitude = np.where(sheared, self.shear.strain_amplitude, 0.0)
        strain = amplitude * np.sin(angle)
        rate = amplitude * omega * np.cos(angle)
        model = self.point.model
        elastic = (kernel() if model.compiled else spring)(strain, model.modulus)
        stress = elastic + model.viscosity * rate + model.noise * self.noise
        return {"time": time, "strain": strain, "periodic_overall_xy": -stress}

    def summary(self):
        shear = self.shear
        protocol = {
            "kind": "oscillatory",
            "strain_amplitude": shear.strain_amplitude,
            "period": self.period,
            "shear_start": shear.pre_periods * self.period,
            "periods": shear.periods,
            "shear_end": (shear.pre_periods + shear.periods) * self.period,
            "end": (self.rows - 1) * self.period / STEPS_PER_PERIOD,
        }
        return {
            "derived": {"omega": 2 * np.pi / self.period},
            "protocol": protocol,
            "checks": {},
            "flags": {"not_at_rest": False},
        }


def fail(how):
    if how == "physics":
        msg = "the spring broke at t = 3 s: use a softer one"
        raise SimulationError(msg)
    if how == "bug":
        msg = "a bug in the model"
        raise ZeroDivisionError(msg)
    if how == "exit":
        os._exit(7)
    if how == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "full":
        raise OSError(28, "No space left on device")


def spring(strain, modulus):
    return modulus * strain


@cache
def kernel():
    from shear_sim.compiled import jit  # half of the time that a process takes to start

    return jit(spring)


def most_threads(point):
    return point.model.strips


def start(point, streams):
    return _Simulation(point, streams)


def derive(columns):
    return {"shear_stress": -columns["periodic_overall_xy"]}


def compile_for(points):
    for point in points:
        if point.model.fault == "uncompilable":
            msg = "contact law: no such function"
            raise TypeError(msg)
    if any(point.model.compiled for point in points):
        kernel()(np.zeros(1), 1.0)


if "kelvin_voigt" not in models.KINDS:
    models.KINDS = (*models.KINDS, "kelvin_voigt")
    sys.modules["shear_sim.models.kelvin_voigt"] = sys.modules[__name__]
