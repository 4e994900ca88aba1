"""What particles are coloured by: the body that they are of, or a number with its scale."""

from collections.abc import Sequence
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
_TITLES = {
    "pressure": "pressure of a particle",
    "spin": "spin",
    "speed": "speed",
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
    """Colours of the particles of a job, which mean the same in all of its snapshots.

    Parameters
    ----------
    particles : sequence of Snapshot
    gradient : (len(particles), 2, 2)
        Imposed deformation gradient at each.
    colour : Colour
    tints : (N,)
        Colours of particles where they show no number.
    """

    def __init__(
        self, particles: Sequence[Snapshot], gradient: FloatArray, colour: Colour,
        tints: NDArray[np.str_],
    ) -> None:  # fmt: skip
        self.colour, self._tints = colour, tints
        self._fixed = [s.fixed for s in particles]
        self._values = _values(particles, gradient, colour)
        self._scale = _limits(self._values, colour)

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
        bar.outline.set_visible(False)

    def _beyond(self) -> Literal["neither", "min", "max", "both"]:
        """Return at which ends of the scale there are values beyond."""
        low, high = self._scale
        below = min(float(v.min()) for v in self._values) < low
        above = max(float(v.max()) for v in self._values) > high
        if below and above:
            return "both"
        return "min" if below else "max" if above else "neither"


def _values(particles: Sequence[Snapshot], gradient: FloatArray, colour: str) -> list[FloatArray]:
    """Return what the particles (N,) are coloured by, snapshot by snapshot."""
    first = particles[0]
    if colour == "pressure":
        return [particle_pressure(s) for s in particles]
    if colour == "spin":
        return [s.spin for s in particles]
    if colour == "energy":
        return [s.energy for s in particles if s.energy is not None]
    if colour == "speed":
        return [np.hypot(*s.velocity.T) for s in particles]
    if colour == "displacement":
        size = 2 * float(first.radius.mean())
        return [
            np.hypot(*displacement(s, first, each @ np.linalg.inv(gradient[0])).T) / size
            for s, each in zip(particles, gradient, strict=True)
        ]
    return []


def _limits(values: Sequence[FloatArray], colour: str) -> tuple[float, float]:
    """Return the ends of the colour scale of all snapshots.

    At an impulsive start all may be much faster than ever after: that would be all there is to see.
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
    return (low, high) if low < high else (low, low + 1.0)
