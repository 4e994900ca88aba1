"""Tables as `shear_sim.aggregate.make_tables` returns them, made by hand for the figures."""

import numpy as np
import pandas as pd

AMPLITUDES = [0.001, 0.01, 0.1, 1.0]
MODULI = ("storage_modulus", "loss_modulus")
LARGE_AMPLITUDE = ("third_harmonic_ratio", "stiffening_ratio", "thickening_ratio")
AMPLITUDE, FRICTION = "shear.strain_amplitude", "model.friction"


def attributed(table, done=12, planned=12):
    """Return ``table`` with the attrs that `make_tables` gives."""
    table.attrs = {
        "units": dict.fromkeys(table, "1")
        | {name: "Pa" for name in table if "modulus" in name or "stress" in name},
        "done": done,
        "planned": planned,
        "study": "by hand",
        "tensor": "periodic",
        "paired": True,
    }
    return table


def points(cells, replicates=12, planned=12):
    """Return a table of points; a cell is its parameters and quantities."""
    rows = []
    for number, cell in enumerate(cells):
        row = {"scene": "gel", "block": "main", "replicates": replicates, "planned": planned}
        row |= {"failed": 0, "flagged": 0, "n": replicates, "ci_level": 0.95} | cell
        fixed = {k: v for k, v in cell.items() if "." in k and k != AMPLITUDE}
        row |= {"point": f"{number:016x}", "curve": str(sorted(fixed.items())) + row["scene"]}
        for name in (*MODULI, *LARGE_AMPLITUDE):
            mean = row.pop(name, 100.0)
            row[f"{name}_mean"] = mean
            row[f"{name}_ci_low"] = row.get(f"{name}_ci_low", mean - 0.1 * abs(mean))
            row[f"{name}_ci_high"] = row.get(f"{name}_ci_high", mean + 0.1 * abs(mean))
            row[f"{name}_ci_method"] = "BCa"
        rows.append(row)
    table = pd.DataFrame(rows)
    return attributed(table, int(table["replicates"].sum()), int(table["planned"].sum()))


def main_study():
    """Return points like those of configs/main.yaml: two scenes, friction, and two branches."""
    base = {
        FRICTION: 0.01,
        "model.links.cut": "cells",
        "model.young_modulus": 8000.0,
        "model.contact_law.kind": "divergent",
        "model.contact_law.begin": np.nan,
    }
    cells = [
        base
        | {
            "scene": scene,
            "model.links.cut": cut,
            FRICTION: friction,
            AMPLITUDE: amplitude,
            "storage_modulus": 1000.0 / (1 + amplitude / friction),
        }
        for scene, cut in (("gel", "cells"), ("loose", "none"))
        for friction in (0.01, 0.1, 1.0)
        for amplitude in AMPLITUDES
    ]
    for amplitude in (0.01, 1.0):
        strain = {AMPLITUDE: amplitude}
        cells += [base | strain | {"model.young_modulus": e} for e in (2000.0, 32000.0)]
        law = {"model.contact_law.kind": "plateau", "model.contact_law.begin": 0.3}
        cells.append(base | strain | law)
    return points(cells)


def features(curves, where):
    """Return landmarks of all curves of a table of points.

    ``where`` gives, of (landmark, curve's first point), its strain; inf and -inf are beyond the
    amplitudes, nan is absent.
    """
    rows = []
    for curve, of_curve in curves.groupby("curve", sort=False):
        first = of_curve.iloc[0]
        keys = {key: first[key] for key in curves if "." in key and key != AMPLITUDE}
        shared = {"curve": curve, "scene": first["scene"], **keys, "replicates": 12, "planned": 12}
        shared |= {"amplitudes": len(of_curve), "ci_level": 0.95}
        for name in ("low_strain_plateau", "softening", "loss_peak", "yield"):
            strain = where(name, first)
            limits = of_curve[AMPLITUDE].max(), of_curve[AMPLITUDE].min()
            censored, limit = "", np.nan
            if not np.isfinite(strain):
                censored = {np.inf: "above", -np.inf: "below"}.get(strain, "absent")
                limit = limits[0 if strain > 0 else 1] if censored != "absent" else np.nan
                strain = np.nan
            row = shared | {"landmark": name, "censored": censored, "strain_limit": limit}
            values = {"strain": strain, "total_stress": 50 * strain}
            values |= dict.fromkeys(MODULI, 200.0 if np.isfinite(strain) else np.nan)
            for quantity, value in values.items():
                row |= {quantity: value, f"{quantity}_ci_method": "BCa"}
                row |= {f"{quantity}_ci_low": 0.9 * value, f"{quantity}_ci_high": 1.1 * value}
            rows.append(row)
    return attributed(pd.DataFrame(rows))


def harmonics(curves, storage_n, loss_n, replicates=2):
    """Return a table of harmonics, the same of every point; replicates scatter about the mean."""
    rows = [
        {
            "point": point,
            "replicate": replicate,
            "harmonic": n,
            "storage_modulus": storage * (0.5 + replicate),
            "loss_modulus": loss * (0.5 + replicate),
        }
        for point in curves["point"]
        for replicate in range(replicates)
        for n, (storage, loss) in enumerate(zip(storage_n, loss_n, strict=True), start=1)
    ]
    return attributed(pd.DataFrame(rows))


def runs(curves):
    """Return a table of runs, two of each point, of which the second of each is beyond limits."""
    rows = [
        {
            "job": f"{point['point']}{replicate}",
            "scene": point["scene"],
            "replicate": replicate,
            **{key: point[key] for key in curves if "." in key},
            "cycle_change": 0.5 if replicate else 1e-5,
            "surface_internal_ratio": 1.5 if replicate else 1.01,
            "baseline_noise": 0.0,
            "asymmetry": np.nan,
            "flagged": bool(replicate),
            "flags": "cycle_change" if replicate else "",
        }
        for _, point in curves.iterrows()
        for replicate in range(2)
    ]
    return attributed(pd.DataFrame(rows))
