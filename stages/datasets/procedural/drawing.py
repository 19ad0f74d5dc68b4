"""Draw: the random choices of one shape, the same on every machine, Python and NumPy."""

from __future__ import annotations

from random import Random


class Chance:
    """A stream of random choices that depends on `key` only.

    Built on `random.Random(str).random()`, the one sequence that Python promises never to change; NumPy's generators
    may change between versions, and `hash()` changes between processes.
    """

    def __init__(self, *key: str | int) -> None:
        self._random = Random("/".join(map(str, key)))

    def between(self, low: float, high: float) -> float:
        """Uniform in [low, high)."""
        return low + (high - low) * self._random.random()

    def chance(self, probability: float) -> bool:
        return self._random.random() < probability

    def pick(self, options: dict[str, float]) -> str:
        """One of the keys, in proportion to its weight."""
        left = self._random.random() * sum(options.values())
        for option, weight in options.items():
            left -= weight
            if left < 0:
                return option
        return option

    def whole(self, low: int, high: int) -> int:
        """Uniform whole number, both ends included."""
        return low + int(self._random.random() * (high - low + 1))
