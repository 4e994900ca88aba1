"""Contact laws: elastic force between two overlapping discs at distance d < D = r_i + r_j.

Every law has the signature ``law(d, D, k, p) -> force`` per metre of depth [N/m] and is repulsive,
that is negative, as in the call-back of the manual (part 2, section 4.3.2). d, D in m, k in N/m².
``p`` holds (repulsion, begin, end, slope) of the study's contact law [-]. They are plain
functions that the kernels are compiled with, so that a user's own law runs at the same speed.
"""

import math
import sys
import traceback
from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

import numba
from numba.extending import register_jitable

from shear_sim.compiled import digest

if TYPE_CHECKING:
    from shear_sim.models.microgel.parameters import ContactLaw

LawParameters = tuple[float, float, float, float]
Law = Callable[[float, float, float, LawParameters], float]

LAW_FILE = "<user contact law>"  # what Python calls the user's file
CLAMP = 1000.0  # largest force in units of k D, eq. S1-6


@register_jitable
def divergent(d: float, D: float, k: float, p: LawParameters) -> float:
    """Return −k (D − d) [(1 − κ) + κ D/d], at least −1000 k D.

    κ = p[0] = 1 is eq. S1-5b with the clamp S1-6, κ = 0 is the linear law, eq. S1-5a.
    """
    kappa = p[0]
    # The clamp acts long before d = D/10⁶; the bound only keeps 0 · ∞ out.
    force = k * (D - d) * (1.0 - kappa + kappa * D / max(d, 1e-6 * D))
    return -min(force, CLAMP * k * D)


@register_jitable
def plateau_distance(d: float, D: float, p: LawParameters) -> float:
    """Return the distance h(d) that the plateau law feels (part 2, section 4.3.3)."""
    begin, end, slope = p[1] * D, p[2] * D, p[3]
    if d >= end:
        return d
    if d >= begin:
        return end + (d - end) * slope
    return d / begin * (end + (begin - end) * slope)


@register_jitable
def plateau(d: float, D: float, k: float, p: LawParameters) -> float:
    """Return the divergent law at the distance h(d): a soft plateau for sponge-like discs."""
    return divergent(plateau_distance(d, D, p), D, k, p)


@register_jitable
def hertz(d: float, D: float, k: float, p: LawParameters) -> float:  # noqa: ARG001
    """Return −1.1 E R^(−1/2) (D − d)^(3/2), R = D/2 and E = 8 k/π: eq. S1-13 with S1-8."""
    overlap = D - d
    return -1.1 * (8.0 / math.pi) * k * overlap * math.sqrt(2.0 * overlap / D)


BUILT_IN: dict[str, Law] = {
    "linear": divergent,
    "divergent": divergent,
    "plateau": plateau,
    "hertz": hertz,
}


def law_parameters(section: "ContactLaw") -> LawParameters:
    """Return (repulsion, begin, end, slope) of a study's contact law [-]."""
    return (
        0.0 if section.kind == "linear" else float(getattr(section, "repulsion", 1.0)),
        float(getattr(section, "begin", 1.0)),
        float(getattr(section, "end", 1.0)),
        float(getattr(section, "slope", 1.0)),
    )


def law_of(section: "ContactLaw") -> tuple[Law, LawParameters]:
    """Return the force function of a study's contact law and its parameters.

    Raises
    ------
    ValueError
        If a user's law does not work, see `custom`.
    """
    p = law_parameters(section)
    if section.kind == "custom":
        if section.source is None:
            msg = "the custom contact law has no source: read the study with load_study"
            raise ValueError(msg)
        return custom(section.source), p
    return BUILT_IN[section.kind], p


@cache
def custom(source: str) -> Law:
    """Return the law that the user's Python file defines as ``contact_force``.

    Other functions of the file may be called by it.

    Raises
    ------
    ValueError
        If the file cannot be executed or compiled, or the force is not a finite number or
        attracts at every distance; says where, in one sentence.
    """
    name = f"user_contact_law_{digest(source)}"
    module = ModuleType(name)
    sys.modules[name] = module  # Numba finds it by name when it loads the compiled kernels
    try:
        exec(compile(source, LAW_FILE, "exec"), module.__dict__)  # noqa: S102
    except BaseException as error:  # also SystemExit: whatever the user's lines raise
        msg = f"{_law_line(error)}{type(error).__name__}: {error}"
        raise ValueError(msg) from None
    for function in vars(module).values():
        if isinstance(function, FunctionType) and function.__code__.co_filename == LAW_FILE:
            register_jitable(function)
    force = vars(module).get("contact_force")
    if not isinstance(force, FunctionType):
        msg = "must define contact_force(distance, contact_distance, stiffness, repulsion)"
        raise ValueError(msg)
    _try_law(force)

    @register_jitable
    def law(d: float, D: float, k: float, p: LawParameters) -> float:
        return float(force(d, D, k, p[0]))

    law.__name__ = f"custom_{digest(source)}"  # names the compiled kernels
    return law


def _try_law(force: Callable[..., Any]) -> None:
    """Compile a user's law and call it at some distances."""
    compiled = numba.njit(error_model="numpy")(force)
    attracts = True
    for ratio in (0.999999, 0.9, 0.5, 0.1):
        try:
            value = float(compiled(ratio * 1e-4, 1e-4, 3000.0, 1.0))
        except numba.core.errors.NumbaError as error:
            # The first line of such a message names the stage of the compiler, the next the fault.
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            fault = next((line for line in lines if not line.startswith("Failed in")), lines[0])
            loc = getattr(error, "loc", None)
            where = f"line {loc.line}: " if loc else ""
            msg = f"{where}cannot be compiled: {fault}"
            raise ValueError(msg) from None
        except Exception as error:
            msg = f"{_law_line(error)}{type(error).__name__}: {error}"
            raise ValueError(msg) from None
        if not math.isfinite(value):
            msg = f"contact_force is {value} at {ratio:g} of the contact distance"
            raise ValueError(msg)
        attracts &= value > 0
    if attracts:
        msg = (
            "contact_force must be negative (repulsive), but it is positive at every distance "
            f"below contact, {value:g} at {ratio:g} of it: turn its sign"
        )
        raise ValueError(msg)


def _law_line(error: BaseException) -> str:
    """Return ``line n: `` of the user's file where ``error`` was raised."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == LAW_FILE]
    return f"line {frames[-1].lineno}: " if frames else ""
