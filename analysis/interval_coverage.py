"""How often the intervals and p-values of `shear-sim aggregate` are right, on made-up studies.

.venv/bin/python analysis/interval_coverage.py        (1,000 studies of each design and size)
.venv/bin/python analysis/interval_coverage.py --studies 200      (noisier, in a fifth of the time)
.venv/bin/python analysis/interval_coverage.py --each             (every interval, not only kinds)

The packings of a made-up study scatter as real ones do: each has a plateau modulus, a strain at
which friction gives way and one at which it yields, lognormal with a width of 0.3, and every
modulus has noise of 10 % of its own. Three curves of eight amplitudes differ in a parameter x = 1,
5, 100 (yield strain ~ x^0.2), a fourth differs from the first in nothing, and a fifth, of x = 2000,
yields so near the largest amplitude that some resamples do not. Plain means, as in steady shear,
are of lognormal values of widths 0.3 and 1 and of normal ones about zero. What is true is read
from the mean of 400,000 packings by the same definitions. An interval covers if the truth lies in
it; 95 % of them should.

In paired studies, replicate r is one packing at all amplitudes and all x, and is resampled whole.
In independent ones, each run has a packing of its own, as in the historical studies.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate.columns import CURVE_QUANTITIES
from shear_sim.aggregate.contrasts import Comparison, compare
from shear_sim.aggregate.ensemble import Ensemble, Replicates
from shear_sim.aggregate.features import Curve, landmark_intervals
from shear_sim.aggregate.response import (
    MAY_BE_LOGARITHMIC,
    OF_LANDMARKS,
    Means,
    contributions,
    curve_quantities,
)
from shear_sim.statistics import holm, interval, intervals

FloatArray = NDArray[np.float64]
Key = tuple[str, str]  # kind of an interval, and which one
#: Of each interval asked for: whether it covers, or None where there is none.
Outcomes = dict[Key, list[bool | None]]

AMPLITUDES = np.array([0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0])
OMEGA = np.full(len(AMPLITUDES), 100.0)
X = (1.0, 5.0, 100.0)
LATE = 2000.0  # x of the curve that yields near the end
YIELD = 0.2  # exponent of the yield strain in x
WIDTH, NOISE, HARMONIC_NOISE = 0.3, 0.1, 0.002
REPLICATES = (6, 12, 20)
CHUNKS, CHUNK = 40, 10_000  # packings whose mean is the truth
RESAMPLES = 2000


def against(values: str, effect: str, weights: Sequence[float]) -> Comparison:
    return Comparison("x", "", (), {}, "", values, effect, np.array(weights))


_ASIDE = np.log(X) - np.log(X).mean()
_PLAIN = np.array(X) - np.mean(X)
#: Comparisons, and which of the curves they compare.
COMPARISONS = {
    "exponents": (against("1; 5; 100", "exponent", _ASIDE / (_ASIDE @ _ASIDE)), (0, 1, 2)),
    "slopes": (against("1; 5; 100", "slope", _PLAIN / (_PLAIN @ _PLAIN)), (0, 1, 2)),
    "ratios": (against("100; 1", "ratio", [1, -1]), (2, 0)),
    "ratios of equal curves": (against("1; 1", "ratio", [1, -1]), (3, 0)),
}
RATIOS = {
    "tan_delta",
    "third_harmonic_ratio",
    "even_harmonic_ratio",
    "stiffening_ratio",
    "thickening_ratio",
    "plastic_ratio",
}
#: Plain means: the true one, and how values are drawn.
PLAIN_MEANS: dict[str, tuple[float, Callable[[np.random.Generator, int], FloatArray]]] = {
    "lognormal, 0.3": (math.exp(0.045), lambda rng, n: rng.lognormal(0.0, 0.3, n)),
    "lognormal, 1": (math.exp(0.5), lambda rng, n: rng.lognormal(0.0, 1.0, n)),
    "normal about zero": (0.0, lambda rng, n: rng.normal(size=n)),
}


def response(rng: np.random.Generator, of: FloatArray, amplitude: float, x: float) -> FloatArray:
    """Return what runs of packings (n, 3) contribute to a mean response, (n, 21)."""
    plateau, slip, flow = np.exp(of).T * np.array([[1000.0], [0.01], [0.7 * x**YIELD]])
    a, b = amplitude / slip, amplitude / flow
    noise = np.exp(NOISE * rng.normal(size=(2, len(of))))
    waves = HARMONIC_NOISE * plateau[:, None] * rng.normal(size=(2, len(of), 9))
    waves[0, :, 0] = plateau * (0.6 / (1 + a**2) + 0.4 / (1 + b**2)) * noise[0]
    waves[1, :, 0] = plateau * (0.02 + 0.5 * a / (1 + a**2) + 0.5 * b / (1 + b**2)) * noise[1]
    waves[0, :, 2] -= 0.05 * plateau * a**2 / (1 + a**2)
    waves[1, :, 2] += 0.02 * plateau * a**2 / (1 + a**2)
    return contributions(*waves, 1.05 * amplitude * np.hypot(*waves[..., 0]))


def made_up(rng: np.random.Generator, n: int, *, paired: bool) -> list[FloatArray]:
    """Return the runs of the five curves of one made-up study, each (P, n, 21)."""
    shared = WIDTH * rng.normal(size=(n, 3))
    return [
        np.array(
            [
                response(rng, shared if paired else WIDTH * rng.normal(size=(n, 3)), amplitude, x)
                for amplitude in AMPLITUDES
            ]
        )
        for x in (*X, X[0], LATE)
    ]


def as_curve(runs: FloatArray) -> Curve:
    """Return the runs (P, n, 21) of a curve as `shear_sim.aggregate` keeps them."""
    number = np.arange(runs.shape[1])
    points = [Replicates(number, point[:, OF_LANDMARKS]) for point in runs]
    return Curve(AMPLITUDES, points, len(number))


def truth(chunks: int = CHUNKS) -> dict[Key, float]:
    """Return the true value of everything that is estimated: that of the mean packing."""
    rng = np.random.default_rng(0)
    sums = [np.zeros((len(AMPLITUDES), 21)) for _ in range(5)]
    for _ in range(chunks):
        for total, runs in zip(sums, made_up(rng, CHUNK, paired=True), strict=True):
            total += runs.mean(axis=1) / chunks
    sums[3] = sums[0]
    # Two equal runs, whose harmonics have no noise to take off.
    curves = []
    for mean in sums:
        mean[:, -2] = mean[:, 2] ** 2 + mean[:, 11] ** 2
        mean[:, -1] = 0.0
        curves.append(np.repeat(mean[:, None], 2, axis=1))
    for curve in curves:
        curve[:, :, [1, 3, 5, 7, 10, 12, 14, 16]] = 0.0  # even harmonics: nothing but noise
    found = {key: one[0] for key, one in estimates(curves, paired=True, seed=0).items()}
    return found | {("plain means", name): mean for name, (mean, _) in PLAIN_MEANS.items()}


def estimates(
    curves: Sequence[FloatArray], *, paired: bool, resamples: int = RESAMPLES, seed: int
) -> dict[Key, tuple[float, float, float, float]]:
    """Return estimate, bounds and p-value of all that is reported of one study."""
    found: dict[Key, tuple[float, float, float, float]] = {}
    first, ones = curves[0], np.ones((len(AMPLITUDES), curves[0].shape[1]))
    ensemble = Ensemble([Replicates(np.arange(len(p)), p) for p in first], paired=True)
    own = curve_quantities(Means(first.swapaxes(1, 2), ones), AMPLITUDES, OMEGA)
    flat = intervals(
        lambda counts: curve_quantities(ensemble.means(counts), AMPLITUDES, OMEGA).reshape(
            -1, len(counts[0])
        ),
        ensemble.sizes,
        positive=((own > 0).all(axis=2) & MAY_BE_LOGARITHMIC).ravel(),
        resamples=resamples,
        seed=seed,
    )
    names = [(q.name, a) for a in AMPLITUDES for q in CURVE_QUANTITIES]
    for (quantity, amplitude), one in zip(names, flat, strict=True):
        kind = "means: ratios" if quantity in RATIOS else "means: G', G'' and other moduli"
        found[kind, f"{quantity} at {amplitude:g}"] = one.estimate, one.low, one.high, math.nan
    for runs, near_the_end in ((first, False), (curves[4], True)):
        of = as_curve(runs)
        landmarks = landmark_intervals(
            of, Ensemble(of.points, paired=paired), seed=seed, resamples=resamples
        )
        for landmark, quantities in landmarks.items():
            for quantity, one in quantities.items():
                if (landmark, quantity) == ("low_strain_plateau", "strain"):  # no estimate
                    continue
                kind = f"landmarks: {'strains' if quantity == 'strain' else 'moduli there'}"
                if near_the_end:
                    if landmark != "yield":
                        continue
                    kind = "yield near the end (often percentile)"
                key = kind, f"{quantity} at {landmark}"
                found[key] = one.estimate, one.low, one.high, math.nan
    as_curves = [as_curve(runs) for runs in curves]
    for kind, (comparison, which) in COMPARISONS.items():
        compared = [as_curves[k] for k in which]
        for row in compare(comparison, compared, paired=paired, seed=seed, resamples=resamples):
            where = row["landmark"] or f"{row['shear.strain_amplitude']:g}"
            key = f"contrasts: {kind}", f"{row['quantity']} at {where}"
            found[key] = row["estimate"], row["ci_low"], row["ci_high"], row["p"]
    return found


def simulate(
    true: dict[Key, float], n: int, *, paired: bool, studies: int, resamples: int = RESAMPLES
) -> tuple[Outcomes, list[FloatArray]]:
    """Return what the intervals of many studies cover, and the p-values of equal curves."""
    outcomes: Outcomes = defaultdict(list)
    p_values = []
    for number in range(studies):
        runs = made_up(np.random.default_rng([n, number, paired]), n, paired=paired)
        found = estimates(runs, paired=paired, resamples=resamples, seed=number)
        for key, value in true.items():
            if math.isfinite(value) and key in found:
                _, low, high, _ = found[key]
                outcomes[key].append(None if math.isnan(low) else low <= value <= high)
        rng = np.random.default_rng([n, number, 2])
        for name, (mean, draw) in PLAIN_MEANS.items():
            one = interval(draw(rng, n), resamples=resamples, seed=number)
            outcomes["plain means", name].append(one.low <= mean <= one.high)
        equal = [one[3] for (kind, _), one in found.items() if "equal" in kind]
        p_values.append(np.array(equal))
    return outcomes, p_values


def rate(covers: Sequence[bool | None]) -> float:
    """Return how many of the intervals that there are cover."""
    known = [c for c in covers if c is not None]
    return float(np.mean(known)) if known else math.nan


def table(columns: dict[int, tuple[Outcomes, list[FloatArray]]], *, each: bool) -> list[str]:
    """Return the lines of the table of one design."""
    numbers = list(columns)
    lines = [f"{'':44}" + "".join(f"{f'n = {n}':>16}" for n in numbers)]
    kinds = dict.fromkeys(kind for outcomes, _ in columns.values() for kind, _ in outcomes)
    for kind in kinds:
        cells = []
        for outcomes, _ in columns.values():
            rates = [rate(covers) for (of, _), covers in outcomes.items() if of == kind]
            cells.append(f"{np.nanmean(rates):.3f} ({np.nanmin(rates):.2f})")
        lines.append(f"{kind:44}" + "".join(f"{cell:>16}" for cell in cells))
        names = [name for of, name in columns[numbers[0]][0] if of == kind] if each else []
        for name in names:
            rates = [rate(outcomes[kind, name]) for outcomes, _ in columns.values()]
            lines.append(f"    {name:40}" + "".join(f"{r:>16.3f}" for r in rates))
    none = [np.mean([c is None for o in out.values() for c in o]) for out, _ in columns.values()]
    lines.append(f"{'without an interval':44}" + "".join(f"{share:>16.4f}" for share in none))
    for level in (0.05, 0.005):
        flat = [np.concatenate(p_values) for _, p_values in columns.values()]
        false = [np.mean(p[np.isfinite(p)] < level) for p in flat]
        title = f"p < {level:g}, where nothing differs"
        lines.append(f"{title:44}" + "".join(f"{share:>16.4f}" for share in false))
    family = [np.mean([(holm(p) < 0.05).any() for p in values]) for _, values in columns.values()]
    title = "any p < 0.05 after Holm, where nothing differs"
    return [*lines, f"{title:44}" + "".join(f"{share:>14.3f}" for share in family)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=1000)
    parser.add_argument("--each", action="store_true")
    chosen = parser.parse_args()
    true = truth()
    print("Share of the intervals (nominal 95 %) that cover: mean over a kind (least of its own).")
    for paired in (True, False):
        columns = {n: simulate(true, n, paired=paired, studies=chosen.studies) for n in REPLICATES}
        print(f"\n{'paired' if paired else 'independent'}, {chosen.studies:,} studies")
        print("\n".join(table(columns, each=chosen.each)), flush=True)


if __name__ == "__main__":
    main()
