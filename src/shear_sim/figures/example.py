"""One run: strain and shear stress against time, and one against the other."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STRAIN, _STRESS = style.UNORDERED[:2]


def example_run(
    columns: "Mapping[str, NDArray[Any]]",
    protocol: Mapping[str, Any],
    moduli: Mapping[str, Any] | None,
    title: str,
    note: str = "",
) -> "Figure":
    """Draw strain and shear stress of one run against time, and one against the other.

    Parameters
    ----------
    columns : mapping of (R,) arrays
        ``time`` [s], ``strain`` [-] and ``shear_stress`` [Pa].
    protocol : mapping
        The ``protocol`` block of the run's summary.
    moduli : mapping, optional
        Its moduli of the periodic tensor: the ellipse of the first harmonics is drawn over the
        Lissajous curve.
    title, note : str
        Which run it is, and how much of the study is there.
    """
    oscillatory = protocol["kind"] == "oscillatory"
    time, strain, stress = (columns[name] for name in ("time", "strain", "shear_stress"))
    unit = protocol["period"] if oscillatory else 1.0
    clock = (time - protocol["shear_start"]) / unit
    end = (protocol["shear_end"] - protocol["shear_start"]) / unit
    with style.figure(style.DOUBLE, 3.3) as figure:
        axes = figure.subplot_mosaic("ac;bc", width_ratios=[1.25, 1])
        axes["b"].sharex(axes["a"])
        axes["a"].tick_params(labelbottom=False)
        axes["a"].plot(clock, strain, color=_STRAIN)
        axes["a"].set_ylabel(r"strain $\gamma$")
        axes["b"].plot(clock, stress, color=_STRESS, linewidth=0.9)
        axes["b"].set_ylabel(r"shear stress $\tau$ [Pa]")
        axes["b"].set_xlabel("time $(t-t_0)/T$" if oscillatory else "time $t-t_0$ [s]")
        for name in "ab":
            axes[name].axvspan(0.0, end, color="0.96", zorder=0)
            axes[name].margins(x=0.0)
        figure.align_ylabels([axes["a"], axes["b"]])
        loops = axes["c"]
        loops.set_xlabel(r"strain $\gamma$")
        loops.set_ylabel(r"shear stress $\tau$ [Pa]")
        sheared = (clock >= 0) & (clock <= end)
        if oscillatory:
            cycles = max(1, math.floor(protocol["periods"] + 1e-6))
            _cycles(loops, clock[sheared], strain[sheared], stress[sheared], cycles)
            if moduli is not None:
                _first_harmonic(loops, protocol["strain_amplitude"], moduli)
            figure.legend(*loops.get_legend_handles_labels(), loc="outside lower right", ncols=3)
        else:
            loops.plot(strain[sheared], stress[sheared], color=_STRESS, linewidth=0.9)
        style.note(figure, title, note)
    return figure


def _cycles(
    axis: "Axes", clock: NDArray[Any], strain: NDArray[Any], stress: NDArray[Any], cycles: int
) -> None:
    """Draw the loop of each whole period, the last one in colour."""
    for cycle in range(cycles):
        rows = (clock >= cycle) & (clock <= cycle + 1)
        if cycle == cycles - 1:
            axis.plot(strain[rows], stress[rows], color=_STRESS, zorder=3, label="last period")
        else:
            label = "before" if cycle == 0 else None
            axis.plot(strain[rows], stress[rows], color="0.6", linewidth=0.7, label=label)


def _first_harmonic(axis: "Axes", amplitude: float, moduli: Mapping[str, Any]) -> None:
    """Draw the ellipse τ₀ + A (G' sin θ + G'' cos θ) against A sin θ."""
    angle = np.linspace(0, 2 * np.pi, 200)
    wave = moduli["in_phase"] * np.sin(angle) + moduli["out_of_phase"] * np.cos(angle)
    axis.plot(
        amplitude * np.sin(angle), moduli["offset"] + wave, "k--", linewidth=0.8, zorder=4,
        label="first harmonic",
    )  # fmt: skip
