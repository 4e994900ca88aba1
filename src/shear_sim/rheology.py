r"""Rheology from a series: storage and loss modulus, harmonics, steady shear viscosity.

The strain imposed is γ(t) = A sin θ with the analytic phase θ = 2π (t − t₀) / T. The stress is read
as

.. math::
    τ(t) = τ_0 + s (t − t_c) + A \sum_{n=1}^{9} [G'_n \sin nθ + G''_n \cos nθ],

all terms by one least squares fit over whole periods after the first, which holds the start-up.
G' = G'_1 and G'' = G''_1 are the moduli of eqs. 14 and A1 of Otsuki & Hayakawa, Phys. Rev. E 95,
062902 (2017), who project a cycle on sin θ and cos θ; fitting constant, drift s and harmonics
jointly removes what drift and unequal sampling leak into those projections. The centre t_c of the
window only fixes where τ₀ is read.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Name of each tensor's moduli in the summary, and the column with its shear stress −σ_xy.
TENSORS = {
    "periodic": "shear_stress",
    "internal": "shear_stress_internal",
    "external": "shear_stress_external",
}
HARMONICS = 9
#: Range outside which each quality of a run is flagged (closed). The first two are the limits of
#: the authors of the method; a change or drift of a tenth is no stationary response.
LIMITS = {
    "baseline_noise": (0.0, 0.10),
    "surface_internal_ratio": (0.70, 1.30),
    "cycle_change": (0.0, 0.10),
    "drift_ratio": (0.0, 0.10),
    "jumps": (0, 0),
    "asymmetry": (0.0, 1e-9),
}
JUMP = 0.15  # step from record to record that counts as a jump / range of the stress
BLOCKS = 10  # of the stationary half of a steady shear, for its scatter

# Whole steps per period make a record's phase exact but for rounding, far below one record.
_EDGE = 1e-6


@dataclass(frozen=True)
class Moduli:
    """Moduli of one stress series; stresses and moduli in Pa.

    ``storage`` and ``loss`` are the first harmonics G' and G''; ``in_phase`` = G' A,
    ``out_of_phase`` = G'' A and ``total`` = |G*| A are the primary values of Table S2-2.
    ``storage_n`` and ``loss_n`` hold G'_n and G''_n, n = 1 first. ``peak`` is half the peak-to-peak
    of the fitted stress without its drift [Pa]. ``offset`` is τ₀, the mean stress [Pa], ``drift`` s
    [Pa/s] (0 where it is not fitted), ``residual`` the root mean square of what the fit leaves
    [Pa]. ``storage_cycles`` and ``loss_cycles`` are G' and G'' of every whole period
    by itself, the first included, after the drift is taken off: equal cycles are a stationary
    response. ``fitted_periods`` and ``rows`` say how much was fitted.
    """

    storage: float
    loss: float
    in_phase: float
    out_of_phase: float
    total: float
    storage_n: tuple[float, ...]
    loss_n: tuple[float, ...]
    peak: float
    offset: float
    drift: float
    residual: float
    storage_cycles: tuple[float, ...]
    loss_cycles: tuple[float, ...]
    fitted_periods: int
    rows: int

    @property
    def magnitude(self) -> float:
        """|G*| = √(G'² + G''²) [Pa]."""
        return math.hypot(self.storage, self.loss)


def moduli(
    time: FloatArray,
    stress: FloatArray,
    *,
    strain_amplitude: float,
    period: float,
    shear_start: float,
    periods: float,
    harmonics: int = HARMONICS,
) -> Moduli:
    """Fit the storage and loss modulus to a shear stress series.

    Parameters
    ----------
    time : (R,)
        Times of the records, increasing [s]. Rows outside the fitted window do not matter.
    stress : (R,)
        Shear stress τ = −σ_xy [Pa].
    strain_amplitude : float
        A of γ(t) = A sin 2π (t − t₀)/T [-].
    period : float
        T [s].
    shear_start : float
        t₀ [s].
    periods : float
        Duration of the oscillation in T; a last part of a period is not used. With one whole
        period that one is fitted, else all but the first. The drift is fitted only where two or
        more periods are: over one, a line is nearly a sum of sines.
    harmonics : int
        Highest harmonic fitted.

    Returns
    -------
    Moduli
        Bit for bit the same for the same series on one type of processor.

    Raises
    ------
    ValueError
        Without a whole period, with fewer than 2 harmonics + 1 rows in any of the periods, or with
        a stress that is not finite.
    """
    time = np.ascontiguousarray(time, dtype=np.float64)
    stress = np.ascontiguousarray(stress, dtype=np.float64)
    if time.ndim != 1 or time.shape != stress.shape:
        msg = f"time {time.shape} and stress {stress.shape} must be two columns of one length"
        raise ValueError(msg)
    if strain_amplitude <= 0 or period <= 0:
        msg = f"strain_amplitude = {strain_amplitude:g} and period = {period:g} s must be positive"
        raise ValueError(msg)
    window, cycles = _designs(time.tobytes(), period, shear_start, periods, harmonics)
    used = stress[cycles[0].start : cycles[-1].stop]
    if not np.isfinite(used).all():
        row = cycles[0].start + int(np.argmin(np.isfinite(used)))
        msg = f"the shear stress is not a finite number at t = {time[row]:g} s (row {row})"
        raise ValueError(msg)

    fit = window.fit(stress)
    drift = float(fit[-1] / period) if window.drift else 0.0
    storage_n, loss_n = _first_to_last(fit / strain_amplitude, harmonics)
    detrended = stress - drift * (time - shear_start)
    by_cycle = [_first_to_last(c.fit(detrended) / strain_amplitude, harmonics) for c in cycles]
    in_phase, out_of_phase = storage_n[0] * strain_amplitude, loss_n[0] * strain_amplitude
    return Moduli(
        storage=storage_n[0],
        loss=loss_n[0],
        in_phase=in_phase,
        out_of_phase=out_of_phase,
        total=math.hypot(in_phase, out_of_phase),
        storage_n=storage_n,
        loss_n=loss_n,
        peak=float(np.ptp(detrended[window.start : window.stop])) / 2.0,
        offset=float(fit[0]),
        drift=drift,
        residual=float(np.sqrt(np.mean(window.residual(stress, fit) ** 2))),
        storage_cycles=tuple(storage[0] for storage, _ in by_cycle),
        loss_cycles=tuple(loss[0] for _, loss in by_cycle),
        fitted_periods=window.periods,
        rows=window.stop - window.start,
    )


def _first_to_last(fit: FloatArray, harmonics: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Split the coefficients of {1, sin θ, cos θ, sin 2θ, ..., t} into storage and loss."""
    waves = fit[1 : 1 + 2 * harmonics]
    return tuple(waves[0::2].tolist()), tuple(waves[1::2].tolist())


@dataclass(frozen=True)
class _Design:
    """The columns of a least squares fit to the rows ``start`` to ``stop``, and their inverse."""

    start: int
    stop: int
    periods: int
    drift: bool
    columns: FloatArray  # (C, rows)
    solve: FloatArray  # (C, rows): (X Xᵀ)⁻¹ X

    def fit(self, series: FloatArray) -> FloatArray:
        """Return the coefficients (C,) of ``series`` (R,).

        Written with einsum, not matrix products: those go through BLAS, whose last bits depend on
        the number of threads, and a job's summary may not. The second pass fits what the first left
        and so makes up for the squared condition number of the normal equations.
        """
        first: FloatArray = np.einsum("ct,t->c", self.solve, series[self.start : self.stop])
        second: FloatArray = np.einsum("ct,t->c", self.solve, self.residual(series, first))
        return first + second

    def residual(self, series: FloatArray, fit: FloatArray) -> FloatArray:
        """Return what ``fit`` leaves of ``series``, of shape (rows,)."""
        model: FloatArray = np.einsum("c,ct->t", fit, self.columns)
        return series[self.start : self.stop] - model


# The jobs of a study share a few time grids; one of 17,000 rows takes 6 MB here.
@lru_cache(maxsize=8)
def _designs(
    time_bytes: bytes, period: float, shear_start: float, periods: float, harmonics: int
) -> tuple[_Design, tuple[_Design, ...]]:
    """Return the design of the fitted window, and that of each whole period."""
    phase = (np.frombuffer(time_bytes, dtype=np.float64) - shear_start) / period
    whole = math.floor(periods + _EDGE)
    if whole < 1:
        msg = f"shear.periods = {periods:g}: moduli need at least one whole period"
        raise ValueError(msg)
    # A period is what follows its start: the record at the start of the shear still holds the
    # stress before the rate jumps.
    edges = np.searchsorted(phase, np.arange(whole + 1) + _EDGE)
    needed = 2 * harmonics + 1
    for cycle, rows in enumerate(np.diff(edges).tolist()):
        if rows < needed:
            msg = (
                f"period {cycle + 1} of the oscillation holds {rows} records, but {harmonics} "
                f"harmonics need {needed} or more: lower record.every"
            )
            raise ValueError(msg)
    first = 0 if whole == 1 else 1
    window = _design(phase, int(edges[first]), int(edges[whole]), whole - first, harmonics)
    cycles = tuple(
        _design(phase, int(edges[k]), int(edges[k + 1]), 1, harmonics) for k in range(whole)
    )
    return window, cycles


def _design(phase: FloatArray, start: int, stop: int, periods: int, harmonics: int) -> _Design:
    """Return the design on {1, sin nθ, cos nθ, t}; t in periods, and only over two or more."""
    rows = phase[start:stop]
    columns = [np.ones_like(rows)]
    for n in range(1, harmonics + 1):
        # The whole turns are taken off first: sin of a large angle loses digits.
        angle = 2.0 * np.pi * ((n * rows) % 1.0)
        columns += [np.sin(angle), np.cos(angle)]
    drift = periods >= 2
    if drift:
        columns.append(rows - rows.mean())
    matrix = np.array(columns)
    gram = np.einsum("at,bt->ab", matrix, matrix)
    if np.linalg.cond(gram) > 1e8:
        msg = f"the {stop - start} records do not cover the periods evenly enough for a fit"
        raise ValueError(msg)
    solve = np.einsum("ab,bt->at", np.linalg.inv(gram), matrix)
    return _Design(start, stop, periods, drift, matrix, solve)


def summarise(
    columns: Mapping[str, FloatArray], protocol: Mapping[str, Any], tensor: str = "periodic"
) -> dict[str, Any]:
    """Return the JSON-ready rheology of one job, the same at run time and in ``aggregate``.

    Parameters
    ----------
    columns : mapping of (R,) arrays
        ``time`` [s] and the shear stresses [Pa] named in `TENSORS`, stored or derived (all of them,
        unless ``protocol["tensors"]`` says which there are); for steady shear ``pressure`` [Pa] as
        well. Series that were not recorded give null.
    protocol : mapping
        The ``protocol`` block of the simulation's summary.
    tensor : str
        The one of `TENSORS` by which an oscillatory run is judged: any other than ``periodic`` only
        for runs that have no periodic one.

    Returns
    -------
    dict
        Oscillatory shear: ``moduli`` (each tensor's `Moduli` as a dict, or None), ``quality``
        (``baseline_noise``: peak-to-peak of the shear stress in the last third of the rest before
        the shear / stress amplitude; ``surface_internal_ratio``: |G*| external / internal;
        ``cycle_change``: relative change of |G*| between the last two periods; ``drift_ratio``:
        drift over one period / stress amplitude; ``jumps`` and ``largest_jump``: see `jumps`, of
        the periodic tensor during the oscillation; None where the protocol says that the stress is
        ``impulsive``: that of rigid bodies jumps at collisions) and ``flags`` (``baseline_noisy``,
        ``surface_internal_differ``: the first two outside their `LIMITS`). Steady shear: ``steady``
        (see `steady_shear`) and ``flags``. A quantity that does not exist, such as a baseline
        without a rest, is None. Where nothing can be fitted, ``flags["no_moduli"]``
        (``"no_steady"``) holds the reason. Protocols of any other kind: ``flags``, without any.
    """
    if protocol["kind"] == "steady":
        return _summarise_steady(columns, protocol)
    if protocol["kind"] != "oscillatory":
        return {"flags": {}}
    found: dict[str, Moduli | None] = {}
    reason = None
    for each in protocol.get("tensors", TENSORS):
        name = TENSORS[each]
        found[each] = None
        if name not in columns:
            if each == tensor or each != "periodic":
                reason = reason or f"the columns that give {name} are not recorded"
            continue
        try:
            found[each] = moduli(
                columns["time"],
                columns[name],
                strain_amplitude=protocol["strain_amplitude"],
                period=protocol["period"],
                shear_start=protocol["shear_start"],
                periods=protocol["periods"],
            )
        except ValueError as error:
            reason = reason or str(error)
    judged = columns
    if tensor != "periodic":
        judged = {**columns, "shear_stress": columns[TENSORS[tensor]]}
    quality = {
        "baseline_noise": _baseline_noise(judged, protocol, found[tensor]),
        "surface_internal_ratio": _surface_internal_ratio(
            found.get("internal"), found.get("external")
        ),
        "cycle_change": _cycle_change(found[tensor]),
        "drift_ratio": _drift_ratio(found[tensor], protocol),
        **_jumps(judged, protocol),
    }
    flags: dict[str, Any] = {
        "baseline_noisy": _outside("baseline_noise", quality),
        "surface_internal_differ": _outside("surface_internal_ratio", quality),
        "no_moduli": reason,
    }
    as_json = {each: None if fit is None else _jsonable(fit) for each, fit in found.items()}
    return {"moduli": as_json, "quality": quality, "flags": flags}


def _jsonable(fit: Moduli) -> dict[str, Any]:
    """Return the fields with lists for tuples, as JSON gives them back."""
    return {key: list(v) if isinstance(v, tuple) else v for key, v in vars(fit).items()}


def _outside(name: str, quality: Mapping[str, float | None]) -> bool | None:
    value, (low, high) = quality[name], LIMITS[name]
    return None if value is None else not low <= value <= high


def jumps(stress: FloatArray, limit: float = JUMP) -> tuple[NDArray[np.intp], float]:
    """Find the steps of a stress series from one record to the next that are jumps.

    A stress tensor without the contacts across the edges of the cell jumps whenever a disc crosses
    an edge; the periodic one has no reason to. A sine alone steps by π/N of its range, with N
    records per period.

    Parameters
    ----------
    stress : (R,)
        Shear stress of consecutive records [Pa].
    limit : float
        Step that counts / range of the series.

    Returns
    -------
    rows : (J,)
        Records before the jumps.
    largest : float
        Largest step / range of the series; 0 for a series without a range.
    """
    steps, spread = np.abs(np.diff(stress)), np.ptp(stress)
    if spread == 0.0:
        return np.empty(0, dtype=np.intp), 0.0
    return np.flatnonzero(steps > limit * spread), float(steps.max() / spread)


def _jumps(
    columns: Mapping[str, FloatArray], protocol: Mapping[str, Any]
) -> dict[str, float | None]:
    nothing: dict[str, float | None] = {"jumps": None, "largest_jump": None}
    if "shear_stress" not in columns or protocol.get("impulsive", False):
        return nothing
    time, edge = columns["time"], _EDGE * protocol["period"]
    # The record at the start of the shear holds the stress before the rate jumps.
    sheared = (time > protocol["shear_start"] + edge) & (time < protocol["shear_end"] - edge)
    stress = columns["shear_stress"][sheared]
    if len(stress) < 2 or not np.isfinite(stress).all():
        return nothing
    rows, largest = jumps(stress)
    return {"jumps": len(rows), "largest_jump": largest}


def _drift_ratio(fit: Moduli | None, protocol: Mapping[str, Any]) -> float | None:
    """Return |drift| over one period / stress amplitude; None where it is not fitted."""
    if fit is None or fit.total == 0.0 or fit.fitted_periods < 2:
        return None
    return abs(fit.drift) * float(protocol["period"]) / fit.total


def _baseline_noise(
    columns: Mapping[str, FloatArray], protocol: Mapping[str, Any], fit: Moduli | None
) -> float | None:
    """Return the peak-to-peak stress of the last third of the first rest / stress amplitude."""
    if fit is None or fit.total == 0.0:
        return None
    time, start = columns["time"], protocol["shear_start"]
    edge = _EDGE * protocol["period"]
    rest = columns["shear_stress"][(time >= start * 2 / 3 - edge) & (time < start - edge)]
    # One record has no peak-to-peak: not a quiet baseline, but none.
    return float(np.ptp(rest) / fit.total) if len(rest) > 1 else None


def _surface_internal_ratio(internal: Moduli | None, external: Moduli | None) -> float | None:
    if internal is None or external is None or internal.magnitude == 0.0:
        return None
    return external.magnitude / internal.magnitude


def _cycle_change(fit: Moduli | None) -> float | None:
    """Return | |G*| of the last period / |G*| of the one before − 1 |."""
    if fit is None or len(fit.storage_cycles) < 2:
        return None
    before, last = (math.hypot(fit.storage_cycles[k], fit.loss_cycles[k]) for k in (-2, -1))
    return abs(last / before - 1.0) if before > 0.0 else None


def _summarise_steady(
    columns: Mapping[str, FloatArray], protocol: Mapping[str, Any]
) -> dict[str, Any]:
    if "shear_stress" not in columns:
        reason = "the columns that give shear_stress are not recorded"
        return {"steady": None, "flags": {"no_steady": reason}}
    try:
        result = steady_shear(
            columns["time"],
            columns["shear_stress"],
            strain_rate=protocol["strain_rate"],
            shear_start=protocol["shear_start"],
            shear_end=protocol["shear_end"],
            pressure=columns.get("pressure"),
        )
    except ValueError as error:
        return {"steady": None, "flags": {"no_steady": str(error)}}
    return {"steady": result, "flags": {"no_steady": None}}


def steady_shear(
    time: FloatArray,
    stress: FloatArray,
    *,
    strain_rate: float,
    shear_start: float,
    shear_end: float,
    pressure: FloatArray | None = None,
) -> dict[str, float | int | None]:
    """Average a steady shear over the second half of its strain.

    Parameters
    ----------
    time, stress, pressure : (R,)
        Times [s], shear stress τ = −σ_xy [Pa] and, where recorded, pressure [Pa].
    strain_rate : float
        Imposed γ̇, of either sign [1/s].
    shear_start, shear_end : float
        First and last instant of the shear [s].

    Returns
    -------
    dict
        ``shear_stress`` [Pa] (mean), ``shear_stress_error`` [Pa] (standard error from the scatter
        of `BLOCKS` consecutive block means, since records of one run are correlated), ``viscosity``
        = mean / γ̇ [Pa s] with ``viscosity_error``, ``pressure`` [Pa], ``stress_ratio`` = |τ| / p
        [-] and ``rows``, the number of records averaged.

    Raises
    ------
    ValueError
        With fewer records than blocks, without a rate, with records that end before the shear, or
        with a stress that is not finite.
    """
    if strain_rate == 0.0:
        msg = "steady shear at strain_rate = 0 has no viscosity"
        raise ValueError(msg)
    if len(time) > 1 and shear_end - time[-1] > 2 * (time[-1] - time[-2]):
        msg = f"the records end at {time[-1]:g} s, but the shear at {shear_end:g} s"
        raise ValueError(msg)
    # The instant that stops the shear is left out: its flow is already the rest's.
    late = (time >= 0.5 * (shear_start + shear_end)) & (time < shear_end)
    used = stress[late]
    if len(used) < BLOCKS:
        msg = (
            f"the second half of the shear holds {len(used)} records, but {BLOCKS} blocks need "
            f"{BLOCKS} or more: lower record.every"
        )
        raise ValueError(msg)
    if not np.isfinite(used).all():
        msg = "the shear stress is not a finite number in the second half of the shear"
        raise ValueError(msg)
    mean = float(np.mean(used))
    blocks = np.array([block.mean() for block in np.array_split(used, BLOCKS)])
    error = float(blocks.std(ddof=1) / np.sqrt(BLOCKS))
    load = None if pressure is None else float(np.mean(pressure[late]))
    return {
        "shear_stress": mean,
        "shear_stress_error": error,
        "viscosity": mean / strain_rate,
        "viscosity_error": error / abs(strain_rate),
        "pressure": load,
        "stress_ratio": abs(mean) / load if load else None,
        "rows": len(used),
    }
