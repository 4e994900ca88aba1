"""What particles are coloured by: the body that they are of, or a number with its scale."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures.geometry import displacement, particle_pressure
from shear_sim.looks import Colour
from shear_sim.models.interface import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

FloatArray = NDArray[np.float64]

_FIXED = "#9a9a9a"
_FULL = 98.0  # percentile that takes the end of a colour scale
_IMPULSIVE = 3.0  # times more than in all others: the first snapshot has no part in the scale
_EQUAL = 1e-9  # relative difference that is only rounding
_TITLES = {
    "pressure": "pressure\nof a particle",
    "spin": "spin",
    "speed": "speed,\nwith the flow",
    "displacement": "non-affine displacement\n[mean diameters]",
    "energy": "elastic energy\nof a particle",
}
#: Parts of colour maps in which no colour is so dark that lines on it are lost.
_MAPS = {
    "pressure": ("YlOrBr", 0.0, 0.72),
    "spin": ("RdBu", 0.12, 0.88),
    "speed": ("YlGnBu", 0.0, 0.75),
    "displacement": ("YlGnBu", 0.0, 0.75),
    "energy": ("YlOrBr", 0.0, 0.72),
}


class Colouring:
    """Colours of the particles of a job, which mean the same in all of these snapshots.

    Parameters
    ----------
    particles : mapping of int to Snapshot
        By their numbers.
    first : Snapshot
        Of the job: displacements are from there.
    since : (n, 2, 2)
        Deformation gradient imposed since then, of each number.
    colour : Colour
    tints : (N,)
        Colours of particles where they show no number.
    """

    def __init__(
        self, particles: Mapping[int, Snapshot], first: Snapshot, since: FloatArray,
        colour: Colour, tints: NDArray[np.str_],
    ) -> None:  # fmt: skip
        self.colour, self._tints = colour, tints
        self._fixed = {n: s.fixed for n, s in particles.items()}
        self._values = _values(particles, first, since, colour)
        self._scale = _limits(list(self._values.values()), colour)

    @property
    def scaled(self) -> bool:
        """Whether colours have a scale."""
        return bool(self._values)

    def faces(self, number: int) -> FloatArray:
        """Return the colours (N, 4) of the particles in snapshot ``number``."""
        from matplotlib.colors import to_rgba_array

        if self.scaled:
            low, high = self._scale
            share = (self._values[number] - low) / (high - low)
            made = np.asarray(self._map(share), np.float64)
        else:
            made = to_rgba_array(self._tints)
        made[self._fixed[number]] = to_rgba_array(_FIXED)
        return made

    @property
    def _map(self) -> "Colormap":
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        name, low, high = _MAPS[self.colour]
        return ListedColormap(colormaps[name](np.linspace(low, high, 256)))

    def bar(self, axis: "Axes", unit: str) -> None:
        """Draw the scale into ``axis``."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colorbar import Colorbar
        from matplotlib.colors import Normalize
        from matplotlib.ticker import MaxNLocator

        mappable = ScalarMappable(Normalize(*self._scale), self._map)
        bar = Colorbar(
            axis, mappable, orientation="horizontal", ticks=MaxNLocator(4), extend=self._beyond()
        )
        text = _TITLES[self.colour]
        # To the left: a power of ten may stand at the right.
        bar.set_label(text if "[" in text or not unit else f"{text} [{unit}]", loc="left")
        bar.outline.set(linewidth=0.4, edgecolor="0.5")

    def _beyond(self) -> Literal["neither", "min", "max", "both"]:
        """Return at which ends of the scale there are values beyond."""
        low, high = self._scale
        below = min(float(v.min()) for v in self._values.values()) < low
        above = max(float(v.max()) for v in self._values.values()) > high
        if below and above:
            return "both"
        return "min" if below else "max" if above else "neither"


def _values(
    particles: Mapping[int, Snapshot], first: Snapshot, since: FloatArray, colour: Colour
) -> dict[int, FloatArray]:
    """Return what the particles (N,) are coloured by, by the number of the snapshot."""
    if colour == Colour.displacement:
        size = 2 * float(first.radius.mean())
        return {
            n: np.hypot(*displacement(s, first, since[n]).T) / size for n, s in particles.items()
        }
    value: Callable[[Snapshot], FloatArray] | None = {
        Colour.pressure: particle_pressure,
        Colour.spin: lambda s: s.spin,
        Colour.energy: lambda s: s.energy,
        Colour.speed: lambda s: np.hypot(*s.velocity.T),
    }.get(colour)
    return {n: value(s) for n, s in particles.items()} if value else {}


def _limits(values: Sequence[FloatArray], colour: str) -> tuple[float, float]:
    """Return the ends of the colour scale of all snapshots.

    At an impulsive start all may be much faster than ever after: that would be all there is to see.
    Where all are equal the scale is from 0 to their value.
    """
    if not values:
        return 0.0, 1.0
    first, *others = (float(np.percentile(np.abs(v), _FULL)) for v in values)
    if len(others) > 1 and first > _IMPULSIVE * max(others) > 0:
        values = values[1:]
    everything = np.concatenate(values)
    low, high = (float(p) for p in np.percentile(everything, [100 - _FULL, _FULL]))
    if colour == "spin":
        low, high = -max(-low, high), max(-low, high)
    elif colour in {"speed", "displacement"}:
        low = 0.0
    if high - low <= _EQUAL * max(abs(low), abs(high)):
        low, high = min(low, 0.0), max(high, 0.0)
    return (low, high) if low < high else (0.0, 1.0)
