"""Tables with rows for single runs: ``runs``, ``cycles`` and ``harmonics``.

All from the index of the results, where the summaries of the runs are: no series is read.
"""

import hashlib
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate import columns as tables
from shear_sim.aggregate.frame import beside, frame
from shear_sim.large_amplitude import measures
from shear_sim.models.interface import Column
from shear_sim.rheology import HARMONICS, LIMITS
from shear_sim.tables import to_json
from shear_sim.variation import AMPLITUDE

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow

FloatArray = NDArray[np.float64]

#: Joins the names of scenes (or blocks) where a point belongs to several, and the flags of a run.
SEPARATOR = "; "


def labelled(planned: "pd.DataFrame", scene_order: Sequence[str]) -> "pd.DataFrame":
    """Add ``scene`` (sorted as in the study file), ``block`` and ``curve`` to the plan's jobs."""
    import pandas as pd

    pairs = planned["labels"].map(json.loads)
    scenes = pairs.map(lambda labels: SEPARATOR.join(dict.fromkeys(scene for _, scene in labels)))
    blocks = pairs.map(lambda labels: SEPARATOR.join(dict.fromkeys(block for block, _ in labels)))
    known = {scene: place for place, scene in enumerate(scene_order)}
    order = sorted(scenes.unique(), key=lambda s: (known.get(s.split(SEPARATOR)[0], len(known)), s))
    scene = pd.Categorical(scenes, categories=order, ordered=True)
    keys = [name for name in map(str, planned) if "." in name and name != AMPLITUDE]
    points = planned.drop_duplicates("point")
    values = points[keys].astype(object).where(points[keys].notna(), None)
    ids = [_digest(row) for row in values.itertuples(index=False, name=None)]
    curves = planned["point"].map(dict(zip(points["point"], ids, strict=True)))
    return planned.drop(columns="labels").assign(scene=scene, block=blocks, curve=curves)


def _digest(values: Sequence[Any]) -> str:
    return hashlib.sha256(to_json(list(values)).encode()).hexdigest()[:16]


class Waves:
    """Harmonics and periods of the stress of all finished runs, from the index of the results.

    Attributes
    ----------
    job : list of str
        Ids of the jobs, in the order of all arrays.
    storage_n, loss_n : (R, 9)
        G'_n and G''_n [Pa]; nan where a run has none.
    strain_amplitude, angular_frequency, peak_stress : (R,)
        A [-], ω [1/s], and half the peak-to-peak of the stress [Pa].
    """

    def __init__(self, index: "pyarrow.Table", tensor: str) -> None:
        self.job: list[str] = index.column("job").to_pylist()
        self._lists = {
            name: _Lists(index, f"moduli.{tensor}.{name}")
            for name in ("storage_n", "loss_n", "storage_cycles", "loss_cycles")
        }
        self.storage_n = self._lists["storage_n"].square(HARMONICS)
        self.loss_n = self._lists["loss_n"].square(HARMONICS)
        self.strain_amplitude = _numbers(index, "protocol.strain_amplitude")
        self.angular_frequency = 2.0 * np.pi / _numbers(index, "protocol.period")
        self.peak_stress = _numbers(index, f"moduli.{tensor}.peak")
        self.fitted_periods = _numbers(index, f"moduli.{tensor}.fitted_periods")

    def rows(self, jobs: "pd.Series[str]") -> NDArray[np.intp]:
        """Return the places of these jobs in the arrays."""
        import pandas as pd

        return pd.Index(self.job).get_indexer(pd.Index(jobs))

    def measures(self, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Return the large-amplitude measures of these runs."""
        return measures(
            self.storage_n[rows],
            self.loss_n[rows],
            strain_amplitude=self.strain_amplitude[rows],
            angular_frequency=self.angular_frequency[rows],
            peak_stress=self.peak_stress[rows],
        )

    def cycles(self, rows: NDArray[np.intp]) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        """Return how many periods each of these runs has, and G' and G'' of all, run by run."""
        storage, loss = self._lists["storage_cycles"], self._lists["loss_cycles"]
        return storage.lengths[rows], storage.flat(rows), loss.flat(rows)


class _Lists:
    """A column of lists of numbers, one list (or none) a row."""

    def __init__(self, index: "pyarrow.Table", name: str) -> None:
        lists = index.column(name).to_pylist() if name in index.column_names else []
        self.values: list[list[float]] = [v or [] for v in lists] or [[]] * index.num_rows
        self.lengths = np.array([len(v) for v in self.values], dtype=np.intp)

    def square(self, width: int) -> FloatArray:
        nothing = [np.nan] * width
        rows = [[*v, *nothing][:width] for v in self.values]
        return np.array(rows, dtype=np.float64).reshape(-1, width)

    def flat(self, rows: NDArray[np.intp]) -> FloatArray:
        return np.array([x for row in rows.tolist() for x in self.values[row]], dtype=np.float64)


def _numbers(index: "pyarrow.Table", name: str) -> FloatArray:
    if name not in index.column_names:
        return np.full(index.num_rows, np.nan)
    values = index.column(name).to_pylist()
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)


def runs_table(
    planned: "pd.DataFrame",
    index: "pd.DataFrame",
    parameters: Sequence[Column],
    waves: Waves,
    tensor: str = "periodic",
    measured: Sequence[tuple[Column, str]] = (),
) -> "pd.DataFrame":
    """Return one row per finished job of the plan.

    Parameters
    ----------
    planned : DataFrame
        The plan, see `labelled`: ``job``, ``point``, ``replicate``, ``scene``, ``block``,
        ``curve``, varied parameters.
    index : DataFrame
        The index of the results without its lists; jobs outside the plan are not looked at.
    parameters : sequence of Column
        The varied parameters.
    waves : Waves
        Harmonics of the same index.
    tensor : str
        The tensor of ``waves``, of the stresses and of the fit beside the moduli.
    measured : sequence of (Column, key)
        What the models measure themselves, see `shear_sim.models.interface.Model`.
    """
    import pandas as pd

    found = planned.merge(
        index.drop(columns=[c for c in planned.columns if c != "job" and c in index]), on="job"
    )
    data: dict[str, Any] = {}
    for name, suffix in tables.TENSORS.items():
        if f"moduli.{name}.storage" in found:
            storage, loss = (
                pd.to_numeric(found[f"moduli.{name}.{part}"]) for part in ("storage", "loss")
            )
            data[f"storage_modulus{suffix}"] = storage
            data[f"loss_modulus{suffix}"] = loss
            data[f"complex_modulus{suffix}"] = np.hypot(storage, loss)
            data[f"tan_delta{suffix}"] = loss / storage.where(storage != 0.0)
    oscillatory = [(column, f"moduli.{tensor}.{key}") for column, key in tables.OSCILLATORY]
    for column, key in (*oscillatory, *tables.STEADY, *tables.QUALITY):
        key = key.replace("asymmetry_periodic", f"asymmetry_{tensor}")
        if key in found:
            data[column.name] = pd.to_numeric(found[key])
        if column.name == "residual_stress" and f"moduli.{tensor}.storage" in found:
            data |= waves.measures(waves.rows(found["job"]))
    for column, key in measured:
        if key in found:
            values = found[key]
            data[column.name] = pd.to_numeric(values) if column.unit else values.astype("str")
    for column in tables.FLAGS[:2]:
        if f"flags.{column.name}" in found:
            data[column.name] = found[f"flags.{column.name}"].astype("str")
    data["flags"] = _flags(found, data)
    nothing = pd.Series(data=True, index=found.index)
    numbers = [column.name for column, _ in measured if column.unit]
    for name in (f"storage_modulus{tables.TENSORS[tensor]}", "shear_stress", *numbers):
        if name in data:
            nothing &= data[name].isna()
    data["flagged"] = nothing | (data["flags"] != "")
    known = {c.name: c for c in (*tables.MODULI, *tables.LARGE_AMPLITUDE, *tables.FLAGS)}
    listed = (*tables.OSCILLATORY, *tables.STEADY, *tables.QUALITY, *measured)
    known |= {column.name: column for column, _ in listed}
    names = [tables.JOB, *tables.LABELS, *parameters, tables.REPLICATE, *[known[n] for n in data]]
    keys = ["scene", *[parameter.name for parameter in parameters], "replicate"]
    return frame(beside(found, data), names, keys)


def _flags(found: "pd.DataFrame", data: "dict[str, pd.Series[Any]]") -> "pd.Series[str]":
    """Return the names of the limits that each run fails."""
    import pandas as pd

    failed = {
        name: data[name].notna() & ~data[name].between(*limits)
        for name, limits in LIMITS.items()
        if name in data
    }
    for name in tables.MODEL_FLAGS:
        if f"flags.{name}" in found:
            failed[name] = found[f"flags.{name}"].astype("boolean").fillna(value=False)
    words = pd.Series("", index=found.index, dtype="str")
    for name, where in failed.items():
        where = where.astype(bool)
        words = words.mask(where, words.where(words == "", words + SEPARATOR) + name)
    return words


def harmonics_table(runs: "pd.DataFrame", waves: Waves) -> "pd.DataFrame":
    """Return one row per run with moduli and harmonic."""
    rows = waves.rows(runs["job"])
    known = np.isfinite(waves.storage_n[rows, 0])
    storage, loss = waves.storage_n[rows[known]], waves.loss_n[rows[known]]
    intensity = np.hypot(storage, loss)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = intensity / intensity[:, :1]
    data = _repeated(runs[known], np.full(int(known.sum()), HARMONICS)) | {
        "harmonic": np.tile(np.arange(1, HARMONICS + 1), int(known.sum())),
        "storage_modulus": storage.ravel(),
        "loss_modulus": loss.ravel(),
        "relative_intensity": np.where(np.isfinite(relative), relative, np.nan).ravel(),
    }
    return frame(data, tables.HARMONICS)


def cycles_table(runs: "pd.DataFrame", waves: Waves) -> "pd.DataFrame":
    """Return one row per run with moduli and whole period."""
    rows = waves.rows(runs["job"])
    lengths, storage, loss = waves.cycles(rows)
    number = np.concatenate([np.arange(1, n + 1) for n in lengths.tolist()] or [np.empty(0, int)])
    left_out = np.repeat(lengths - np.nan_to_num(waves.fitted_periods[rows]), lengths)
    data = _repeated(runs, lengths) | {
        "cycle": number,
        "fitted": number > left_out,
        "storage_modulus": storage,
        "loss_modulus": loss,
    }
    return frame(data, tables.CYCLES)


def _repeated(runs: "pd.DataFrame", times: NDArray[np.intp]) -> dict[str, Any]:
    """Return what says which run a row is of, so many times each."""
    keys = ("job", "point", "replicate")
    return {name: np.repeat(runs[name].to_numpy(), times) for name in keys}
