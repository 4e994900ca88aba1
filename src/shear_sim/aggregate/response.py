"""From single runs to the mean response of a point: what a run contributes, what follows from it.

Moduli and harmonics are averaged over packings. The size of a mean harmonic is more than that of
the true one, by what is left of the noise of single packings, the more so the fewer they are: for
a harmonic that is all noise, by all of it. Its square is therefore taken as the mean product of
*different* packings, whose noises have nothing to do with each other; where that comes out
negative, nothing was found, and the size is zero.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate import columns as tables
from shear_sim.large_amplitude import measures
from shear_sim.rheology import HARMONICS

FloatArray = NDArray[np.float64]

_THIRD, _EVEN = slice(2, 3), slice(1, HARMONICS, 2)  # harmonics, of those from n = 1


class Means(NamedTuple):
    """Means (P, C, K) over the runs drawn of P points in K resamples, and how many (P, K)."""

    values: FloatArray
    drawn: FloatArray


def contributions(storage_n: FloatArray, loss_n: FloatArray, peak: FloatArray) -> FloatArray:
    """Return what each run contributes to a mean response, (R, 21).

    G'_1 to G'_9, G''_1 to G''_9 and the peak stress [Pa]; the squared sizes of the third and of all
    even harmonics [Pa^2].

    Parameters
    ----------
    storage_n, loss_n : (R, 9)
        G'_n and G''_n [Pa].
    peak : (R,)
        Half the peak-to-peak of the stress [Pa].
    """
    square = storage_n**2 + loss_n**2
    powers = [square[:, which].sum(axis=1) for which in (_THIRD, _EVEN)]
    return np.column_stack([storage_n, loss_n, peak, *powers])


#: Quantities of ``curves`` whose logarithm may be taken where they are positive: not the sizes
#: below, which may truly be zero.
MAY_BE_LOGARITHMIC = np.array(
    [
        quantity.name not in {"third_harmonic_ratio", "even_harmonic_ratio"}
        for quantity in tables.CURVE_QUANTITIES
    ]
)
#: Of `contributions`, what landmarks need: G', G'', G'_3, G''_3 and the square of their size.
OF_LANDMARKS = [0, HARMONICS, 2, HARMONICS + 2, 2 * HARMONICS + 1]


def size(waves: FloatArray, power: FloatArray, drawn: FloatArray) -> FloatArray:
    """Return the size (P, K) of mean waves without the noise of single runs.

    Parameters
    ----------
    waves : (P, W, K)
        Means of the parts of the waves: G'_n and G''_n, of one or more harmonics.
    power : (P, K)
        Mean of the sum of their squares.
    drawn : (P, K)
        Runs that were averaged. One alone has no other to compare its noise with.
    """
    square = (waves**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        without = (drawn * square - power) / (drawn - 1.0)
    found: FloatArray = np.sqrt(np.maximum(np.where(drawn > 1.0, without, square), 0.0))
    return found


def curve_quantities(means: Means, amplitude: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the quantities of ``curves``, (P, Q, K), in the order of its columns.

    Parameters
    ----------
    means : Means
        Of `contributions`.
    amplitude, omega : (P,)
        Strain amplitude [-] and angular frequency [1/s].
    """
    values, drawn = means
    storage, loss = values[:, :HARMONICS], values[:, HARMONICS : 2 * HARMONICS]
    peak, third, even = np.moveaxis(values[:, 2 * HARMONICS :], 1, 0)
    first = np.hypot(storage[:, 0], loss[:, 0])

    def without_noise(which: slice, power: FloatArray) -> FloatArray:
        return size(np.concatenate([storage[:, which], loss[:, which]], axis=1), power, drawn)

    found = measures(
        storage.swapaxes(1, 2),
        loss.swapaxes(1, 2),
        strain_amplitude=amplitude[:, None],
        angular_frequency=omega[:, None],
        peak_stress=peak,
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        found |= {
            "third_harmonic_ratio": without_noise(_THIRD, third) / first,
            "even_harmonic_ratio": without_noise(_EVEN, even) / first,
            "storage_modulus": storage[:, 0],
            "loss_modulus": loss[:, 0],
            "complex_modulus": first,
            "tan_delta": loss[:, 0] / storage[:, 0],
            "total_stress": first * amplitude[:, None],
        }
    return np.stack([found[quantity.name] for quantity in tables.CURVE_QUANTITIES], axis=1)


def third_harmonic_ratio(means: Means) -> FloatArray:
    """Return I3/I1 (P, K) of means of `contributions` at `OF_LANDMARKS`."""
    values, drawn = means
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: FloatArray = size(values[:, 2:4], values[:, 4], drawn) / np.hypot(
            values[:, 0], values[:, 1]
        )
    return ratio
