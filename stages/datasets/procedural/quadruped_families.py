"""Families of quadrupeds: what their members' proportions are drawn between."""

from __future__ import annotations

from dataclasses import dataclass

Range = tuple[float, float]


@dataclass(frozen=True)
class AnimalFamily:
    """What its members' lengths, in trunk lengths, and angles, in degrees, are drawn between."""

    leg: Range
    """From the ground to the belly."""
    depth: Range
    """Half the chest's height."""
    width: Range
    """Half the chest's width."""
    tuck: Range
    """Depth at the loin, as a share of the chest's."""
    neck: Range
    rise: Range
    """Of the neck above the level."""
    head: Range
    nod: Range
    """Of the head below the level."""
    tail: Range
    horns: float
    """How often it has them."""
    flop: float
    """How often its ears hang."""
    raised: float
    """How often its tail stands up."""
    mane: float
    """How often it has one."""


FAMILIES = {
    "horse": AnimalFamily(
        (0.5, 0.62),
        (0.17, 0.21),
        (0.12, 0.15),
        (0.8, 0.92),
        (0.42, 0.54),
        (38, 58),
        (0.32, 0.38),
        (35, 60),
        (0.4, 0.55),
        horns=0.0,
        flop=0.0,
        raised=0.0,
        mane=0.7,
    ),
    "dog": AnimalFamily(
        (0.36, 0.52),
        (0.14, 0.18),
        (0.1, 0.13),
        (0.6, 0.78),
        (0.22, 0.3),
        (40, 60),
        (0.26, 0.34),
        (4, 22),
        (0.3, 0.45),
        horns=0.0,
        flop=0.45,
        raised=0.6,
        mane=0.0,
    ),
    "cattle": AnimalFamily(
        (0.32, 0.4),
        (0.2, 0.245),
        (0.15, 0.19),
        (0.92, 1.02),
        (0.24, 0.32),
        (8, 30),
        (0.3, 0.36),
        (30, 50),
        (0.35, 0.5),
        horns=0.75,
        flop=0.5,
        raised=0.0,
        mane=0.0,
    ),
    "goat": AnimalFamily(
        (0.38, 0.5),
        (0.17, 0.2),
        (0.12, 0.15),
        (0.88, 1.0),
        (0.28, 0.36),
        (45, 62),
        (0.23, 0.28),
        (20, 42),
        (0.12, 0.18),
        horns=0.8,
        flop=0.4,
        raised=1.0,
        mane=0.2,
    ),
    "cat": AnimalFamily(
        (0.28, 0.36),
        (0.11, 0.14),
        (0.085, 0.11),
        (0.8, 0.95),
        (0.13, 0.19),
        (28, 50),
        (0.19, 0.23),
        (4, 20),
        (0.5, 0.7),
        horns=0.0,
        flop=0.0,
        raised=0.5,
        mane=0.0,
    ),
}
