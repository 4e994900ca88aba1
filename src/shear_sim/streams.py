"""Random streams that a growing study cannot change."""

import hashlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Streams:
    """The random numbers of one replicate, one independent stream for each purpose.

    Keyed by study seed, replicate and purpose only: replicate r starts from the same numbers at
    every point of a study, so points can be compared in pairs, and a study that grows keeps them.
    """

    seed: int
    replicate: int

    def generator(self, purpose: str) -> np.random.Generator:
        """Return a fresh generator for ``purpose`` (the same numbers at every call)."""
        digest = hashlib.sha256(purpose.encode()).digest()
        words = np.frombuffer(digest[:16], dtype="<u4").tolist()
        # spawn_key, not entropy: SeedSequence([1]) equals SeedSequence([1, 0]).
        key = (self.replicate, *words)
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=key))
