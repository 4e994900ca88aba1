"""What pictures of particles may show: the words of `shear-sim render`.

Apart from what draws, so that the command line knows them without loading that.
"""

from enum import StrEnum


class Colour(StrEnum):
    """What particles are coloured by: the cluster of links that they are of, or a number."""

    particle = "particle"
    pressure = "pressure"
    spin = "spin"
    speed = "speed"
    displacement = "displacement"


class Contacts(StrEnum):
    """What lines between particles show: links, contacts that hold or slide; forces; nothing."""

    state = "state"
    force = "force"
    none = "none"
