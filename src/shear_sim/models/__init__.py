"""The physical models. Each is a package of its own; none imports another."""

from functools import cache
from importlib import import_module
from typing import cast

from shear_sim.models.interface import Model

KINDS = ("microgel", "hard_disc", "soft_particle")
DEFAULT_KIND = "microgel"


@cache
def model(kind: str) -> Model:
    """Return the package of one model, imported at the first call.

    Raises
    ------
    KeyError
        If there is no model of this kind.
    """
    if kind not in KINDS:
        msg = f"no model {kind!r}: one of {', '.join(KINDS)}"
        raise KeyError(msg)
    return cast("Model", import_module(f"shear_sim.models.{kind}"))
