r"""Large-amplitude oscillatory shear: what the harmonics of a stress say beyond G' and G''.

With the strain γ = A sin θ and the odd harmonics of the stress,

.. math::
    τ(θ) = A \sum_{n\,odd} [G'_n \sin nθ + G''_n \cos nθ],

the measures are those of Ewoldt, Hosoi & McKinley, J. Rheol. 52, 1427 (2008): the moduli G'_M
(tangent at γ = 0) and G'_L (secant at γ = A), the viscosities η'_M (tangent at γ̇ = 0) and η'_L
(secant at the largest γ̇), and the relative differences S and T of each pair. The plastic ratio is
that of Ewoldt et al., Rheol. Acta 49, 191 (2010). Even harmonics break the symmetry of a periodic
response under γ → −γ: they measure noise, drift and a packing's own asymmetry.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def measures(
    storage_n: FloatArray,
    loss_n: FloatArray,
    *,
    strain_amplitude: ArrayLike,
    angular_frequency: ArrayLike,
    peak_stress: ArrayLike,
) -> dict[str, FloatArray]:
    """Return the large-amplitude measures of one or many responses.

    Parameters
    ----------
    storage_n, loss_n : (..., H)
        G'_n and G''_n, n = 1 first [Pa].
    strain_amplitude : (...)
        A [-].
    angular_frequency : (...)
        ω [1/s].
    peak_stress : (...)
        Half the peak-to-peak of the stress [Pa]; nan where it is not known.

    Returns
    -------
    dict of (...) arrays
        By the names of `shear_sim.aggregate.columns.LARGE_AMPLITUDE`. A ratio to zero is nan.
    """
    number = np.arange(1, storage_n.shape[-1] + 1)
    odd = number % 2 == 1
    # (−1)^((n−1)/2) for odd n, 0 for even: sin nπ/2.
    sign = np.where(odd, 1 - (number - 1) % 4, 0).astype(np.float64)
    order = np.where(odd, number, 0).astype(np.float64)
    intensity = np.hypot(storage_n, loss_n)
    amplitude, omega = np.asarray(strain_amplitude), np.asarray(angular_frequency)

    def total(waves: FloatArray, weights: FloatArray) -> FloatArray:
        summed: FloatArray = np.einsum("...n,n->...", waves, weights)
        return summed

    tangent, secant = total(storage_n, order), total(storage_n, sign)
    slow, fast = total(loss_n, order * sign) / omega, total(loss_n, np.abs(sign)) / omega
    energy = np.pi * amplitude**2 * loss_n[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = {
            "third_harmonic_ratio": intensity[..., 2] / intensity[..., 0],
            "even_harmonic_ratio": np.sqrt((intensity[..., ~odd] ** 2).sum(axis=-1))
            / intensity[..., 0],
            "minimum_strain_modulus": tangent,
            "large_strain_modulus": secant,
            "minimum_rate_viscosity": slow,
            "large_rate_viscosity": fast,
            "stiffening_ratio": (secant - tangent) / secant,
            "thickening_ratio": (fast - slow) / fast,
            "dissipated_energy": energy,
            # A perfect plastic of this peak stress loses the rectangle 2 A × 2 peak.
            "plastic_ratio": energy / (4.0 * amplitude * np.asarray(peak_stress)),
        }
    return {name: np.where(np.isfinite(values), values, np.nan) for name, values in found.items()}


def lissajous(
    storage_n: FloatArray, loss_n: FloatArray, *, strain_amplitude: float, rows: int = 361
) -> dict[str, FloatArray]:
    """Return one cycle of the stress as its odd harmonics give it, to be drawn as a loop.

    Parameters
    ----------
    storage_n, loss_n : (H,)
        G'_n and G''_n, n = 1 first [Pa].
    strain_amplitude : float
        A [-].
    rows : int
        Points of the closed loop; the last is the first.

    Returns
    -------
    dict of (rows,) arrays
        ``strain`` A sin θ [-] and ``rate`` A cos θ [-], which is γ̇/ω; ``stress`` [Pa] and its two
        parts: ``elastic``, a function of the strain alone, and ``viscous``, one of the rate alone.
    """
    theta = np.linspace(0.0, 2.0 * np.pi, rows)
    number = np.arange(1, len(storage_n) + 1, 2)
    angle = np.outer(number, theta)
    elastic = strain_amplitude * (storage_n[::2] @ np.sin(angle))
    viscous = strain_amplitude * (loss_n[::2] @ np.cos(angle))
    return {
        "strain": strain_amplitude * np.sin(theta),
        "rate": strain_amplitude * np.cos(theta),
        "stress": elastic + viscous,
        "elastic": elastic,
        "viscous": viscous,
    }
