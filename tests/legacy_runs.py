"""Output files of particleShear for tests: a real one, shortened, and analytic ones in its form.

``data/legacy_uncrosslinked_N60.txt.gz`` is every 32nd row of a run of 60 loose discs, with the time
step printed to suit; its moduli are still those of the whole run.
"""

import gzip
import os
import re
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

REAL = Path(__file__).parent / "data" / "legacy_uncrosslinked_N60.txt.gz"
ROWS_PER_PERIOD = 80

STORAGE, LOSS = 1000.0, 200.0  # of the internal tensor of analytic runs [Pa]
SURFACE = 1.25  # external / internal tensor


def reference(name):
    """Return a file of the founders' reference material, or skip: it is no part of the project."""
    folder = os.environ.get("SHEAR_SIM_REFERENCE")
    default = Path(__file__).parents[1].parent / "shared" / "reference"
    path = (Path(folder) if folder else default) / name
    if not path.is_file():
        pytest.skip(f"{path} is not here: SHEAR_SIM_REFERENCE names the folder of {name}")
    return path


def real_text():
    return gzip.decompress(REAL.read_bytes()).decode()


def header_and_table(text):
    """Return the lines of the header, the names of the columns and the table (rows, 42)."""
    lines = text.split("\n")
    end = next(i for i, line in enumerate(lines) if line.startswith("Detailed")) + 1
    table = np.array([line.split("\t") for line in lines[end + 1 :]], dtype=float)
    return lines[:end], lines[end].split("\t"), table


def demodulate(time, stress, amplitude, frequency, pre=2, periods=3):
    """The program's own moduli, its wrong sign of the drift included: what it prints."""
    turns = time * frequency - pre
    before = (time >= 2 * pre / 3 / frequency) & (time < pre / frequency)
    after = (turns > periods + 1e-9) & (turns <= periods + 1 / 3)
    rise = stress[after].mean() - stress[before].mean()
    added = stress + rise / (turns[after].mean() - turns[before].mean()) * turns
    used = (time >= (pre + 1) / frequency) & (time <= (pre + periods) / frequency)
    waves = np.exp(2j * np.pi * turns[used])
    storage = added[used] @ waves.imag / (waves.imag @ waves.imag) / amplitude
    return storage, added[used] @ waves.real / (waves.real @ waves.real) / amplitude


def analytic_text(storage=STORAGE, loss=LOSS, offset=7.0, drift=0.0, blown_up=False, **arguments):
    """Return the output of a run whose internal shear stress is that of a linear material.

    ``arguments`` are those of the program; the strain lags by half a step, as there.
    """
    head, names, _ = header_and_table(real_text())
    head = [line for line in head if line.strip()]
    call = next(line for line in head if "(root_folder=" in line)
    given = dict(re.findall(r"[(,](\w+)=([^,)]*)", call))
    unknown = arguments.keys() - given.keys()
    assert not unknown, unknown
    given |= {name: str(value) for name, value in arguments.items()}
    amplitude, frequency = float(given["amplitude"]), 2506.6282746310003
    step = 1 / (frequency * ROWS_PER_PERIOD)
    index = np.arange(int(6 / frequency / step))
    time = index * step
    turns = time * frequency - 2
    moving = (turns > 1e-9) & (turns <= 3 + 1e-9)
    angle = 2 * np.pi * turns - np.pi / ROWS_PER_PERIOD
    stress = amplitude * (storage * np.sin(angle) + loss * np.cos(angle))
    internal = np.where(moving, stress, 0.0) + offset + drift * time
    external = SURFACE * internal
    other = np.cos(37 * angle)  # something to be carried through, of the size of the stress
    torque, spin = 5 * other, 0.01 * other**2
    zero = np.zeros_like(time)
    strain = np.where(moving, amplitude * (np.sin(angle) + np.pi / ROWS_PER_PERIOD), 0.0)
    rate = np.where(moving, amplitude * 2 * np.pi * frequency * np.cos(2 * np.pi * turns), 0.0)
    weber = [1300 + other, -internal + torque, -internal - torque, 1310 + 2 * other]
    outside = [1290 + other, -external, -external - 3 * other, 1305 + other]
    linear = [w - o for w, o in zip(weber, outside, strict=True)]
    overall = [weber[0] - spin, -internal, -internal, weber[3] - spin]
    columns = [
        *(index, time, strain, rate, external, internal),
        *(*weber, -(other**2), other, other, -2 * other**2, *outside, *linear, *linear),
        *(zero, -7 * other, 7 * other, zero, zero, -torque, torque, zero),
        *(-spin, zero, zero, -spin, *overall),
    ]
    assert len(columns) == len(names) == 42
    table = np.array(columns).T
    if blown_up:
        table[-200, 4:] = np.inf
        table[-199:, 4:] = np.nan
    inner, outer = (demodulate(time, s, amplitude, frequency) for s in (table[:, 5], table[:, 4]))
    printed = {
        "Time step": f"{step!r}s",
        "Strain amplitude": f"{100 * amplitude!r}%",
        "Friction coefficient": given["mu"],
        "Young modulus spheres": f"{given['Young_modulus_spheres']}Pa",
    }
    moduli = {
        "G'": inner[0],
        "G''": inner[1],
        "G'(by surface force)": outer[0],
        "G''(by surface force)": outer[1],
    }
    lines = []
    for line in head:
        label = line.split("=")[0].rstrip()
        if line is call:
            lines.append(f"{call.split('(')[0]}({','.join(map('='.join, given.items()))})")
        elif label in moduli:
            lines.append(f"{label}={float(moduli[label])!r}Pa")
        else:
            lines.append(f"{label} = {printed[label]}" if label in printed else line)
    rows = ("\t".join([str(int(row[0])), *map(repr, row[1:].tolist())]) for row in table)
    return "\n".join([*lines, "\t".join(names), *rows])


def split(text, folder, name):
    """Write ``header_<name>.txt`` and ``stress_<name>.rda``, as the scripts in R split a run."""
    head, names, table = header_and_table(text)
    (folder / f"header_{name}.txt").write_text("\n".join(head) + "\n")
    write_rda(folder / f"stress_{name}.rda", names, table, name)


def write_rda(path, names, table, name="run"):
    """Write a table as R does, with names of its kind."""
    import rdata

    renamed = [column.replace("stress-tensor", "stress.tensor") for column in names]
    frame = pd.DataFrame(table, columns=renamed).astype({"index": "int32"})
    objects = {"stress_data": frame, "origin_file": f"{name}.txt", "origin_root": "runs"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # of files that rdata does not close
        rdata.write_rda(path, objects)
