"""Colours that stand for keypoint ids and classes, the same in pictures, figures and pages."""

from __future__ import annotations

import colorsys

GOLDEN_ANGLE = 137.508  # degrees: neighbouring ids get far-apart hues
IDS = 64
CLASSES = ("#3b8fd0", "#e06b1f", "#1fa37a", "#cc79a7", "#d9a21b", "#7f8c3b", "#9a7fd1", "#b0802f")
COLORS = len(CLASSES)  # classes that are told apart by colour alone


def id_color(number: int) -> str:
    """`#rrggbb` of a semantic id; grey for -1, a detector's nameless keypoint. Repeats after 64."""
    if number < 0:
        return "#808080"
    hue = number % IDS * GOLDEN_ANGLE / 360 % 1
    red, green, blue = colorsys.hls_to_rgb(hue, 0.46 if number % 2 else 0.54, 0.78)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def class_color(place: int) -> str:
    """`#rrggbb` of the class at this place of the list; near Okabe and Ito's (2008) for colour-blind readers, legible
    on dark, too."""
    return CLASSES[place % COLORS]


def rgb(color: str) -> tuple[int, int, int]:
    """`#rrggbb` → bytes."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)
