"""The runs of a study, one after another, for the programs that draw them."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from shear_sim.results import Results, read_job


def by_scene(folder: Path) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield scene, columns and summary of every job of a study's plan."""
    kept = Results.existing(folder)
    plan, _ = kept.plan()
    for job, labels in zip(plan["job"].to_pylist(), plan["labels"].to_pylist(), strict=True):
        columns, summary = read_job(kept.job_file(job))
        yield json.loads(labels)[0][1], columns, summary
