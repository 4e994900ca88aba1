"""The study file that asks for the runs of particleShear, in the words of ours."""

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import yaml

from shear_sim.design import apply, changes_of
from shear_sim.document import round12
from shear_sim.results import flatten

_SCENES = {"crosslinked": ("cells", "lines"), "bulk": ("bulk",), "uncrosslinked": ("none",)}
_SCRIPT = """\
# Runs of particleShear: {runs}, from {first} on, by `shear-sim import-legacy`.
# As a study of its own it asks for the same points with the historical options, of which only the
# contact law is not in the headers: `shear-sim sweep` makes new runs of it, in another folder.

"""


def study_sections(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sections of a study file that ask for a run with this header.

    The steps of the program are left out: it chose them by amplitude and friction, and ours are
    others for the same physics.
    """
    links: dict[str, Any] = {"cut": "none"}
    if values["do_permanent_links"]:
        links = {
            "cut_top_bottom": values["cut_top_bottom"],
            "remove_fraction": values["remove_link_fraction"],
            "stretched_tangential_dashpot": False,
        }
        cuts, avoided = values["cut_lines"], values["avoid_height_spanning_particles"]
        if cuts <= 0:
            links |= {"cut": "bulk"}
        elif values["doCutByTriangulation"]:
            fuzziness = {"edge_fuzziness": values["edge_fuzziness"]}
            # With a single point it could never be avoided, and was not.
            links |= {"cut": "cells", "cuts": cuts, **fuzziness}
            links |= {"avoid_height_spanning": avoided and cuts > 1}
        else:
            angle = {"avoid_angle": values["avoid_horizontal_angle_degree"]}
            links |= {"cut": "lines", "cuts": cuts, "avoid_height_spanning": avoided, **angle}
    sections = {
        "cell": {
            "width": values["width"] * 1e-6,
            "height": values["height"] * 1e-6,
            "boundary": "plates",
        },
        "packing": {
            "discs": values["N"],
            "packing_fraction": values["packing_fraction"],
            "size_ratio": values["bimodal_factor"],
            "density": values["density"],
        },
        "model": {
            "young_modulus": values["Young_modulus_spheres"],
            "friction": values["mu"],
            "relative_viscosity": values["relative_viscosity"],
            "tangential_ratio": values["relative_transversal_link_strength"],
            "contact_law": {
                "kind": "divergent",
                "repulsion": values["central_repulsion_coefficient"],
            },
            "sliding": "reset",
            "lever_arms": "particleshear",
            "contacts": {
                "normal_factor": values["interface_reenforcement_central"],
                "tangential_factor": values["interface_reenforcement_tangential"],
            },
            "links": links,
            "scale_viscosity": not values["keep_viscosity_coefficients_constant"],
            "damping": {"decay": values["cool_factor"], "spin": "zero"},
        },
        "shear": {
            "strain_amplitude": values["amplitude"],
            "relative_frequency": values["relative_frequency"],
            "pre_periods": values["pre_periods"],
            "periods": values["periods"],
            "post_periods": values["post_periods"],
        },
    }
    rounded: dict[str, Any] = _rounded(sections)
    return rounded


def _rounded(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {name: _rounded(value) for name, value in tree.items()}
    return round12(tree) if isinstance(tree, float) else tree


def study_text(points: Iterable[dict[str, Any]], *, first: str) -> str:
    """Return the study file that asks for these points, each given as its sections.

    What all points share is the base, what those of a scene share its scene; the rest is a grid
    where the points fill one, else a list.
    """
    counts = Counter(json.dumps(flatten(point)) for point in points)
    leaves = [json.loads(text) for text in counts]
    base = _shared(leaves)
    scenes: dict[str, dict[str, Any]] = {}
    blocks: dict[str, tuple[dict[str, Any], list[str]]] = {}
    for scene, cuts in _SCENES.items():
        inside = [point for point in leaves if point["model.links.cut"] in cuts]
        if not inside:
            continue
        shared = _shared(inside)
        scenes[scene] = {key: value for key, value in shared.items() if key not in base}
        rest = [{k: v for k, v in point.items() if k not in shared} for point in inside]
        axes = _axes(rest)
        blocks.setdefault(json.dumps(axes), (axes, []))[1].append(scene)
    sweep = [{"name": "_".join(names), "scenes": names, **axes} for axes, names in blocks.values()]
    study = {
        **apply({}, changes_of(base, ())),
        "scenes": scenes,
        "sweep": sweep,
        "replicates": max(counts.values()),
    }
    text: str = yaml.safe_dump(study, sort_keys=False, default_flow_style=None, width=88)
    return _SCRIPT.format(runs=sum(counts.values()), first=first) + text


def _shared(points: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what all points have, with the same value."""
    return {
        key: value
        for key, value in points[0].items()
        if all(key in point and point[key] == value for point in points)
    }


def _axes(points: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the axes of a block that makes these points."""
    keys = list(dict.fromkeys(key for point in points for key in point))
    if not keys:
        return {}
    values = {key: sorted({point[key] for point in points if key in point}) for key in keys}
    full = all(len(point) == len(keys) for point in points)
    if full and math.prod(len(of_key) for of_key in values.values()) == len(points):
        return {"grid": values}
    return {"list": sorted(points, key=lambda point: json.dumps(point))}
