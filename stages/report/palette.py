"""Colours that stand for keypoint ids and classes, the same in pictures, figures and pages."""

from __future__ import annotations

import colorsys

GOLDEN_ANGLE = 137.508   # degrees: neighbouring ids get far-apart hues
IDS = 64


def id_color(number: int) -> str:
    """`#rrggbb` of a semantic id; grey for -1, a detector's nameless keypoint. Repeats after 64."""
    if number < 0:
        return "#808080"
    hue = number % IDS * GOLDEN_ANGLE / 360 % 1
    red, green, blue = colorsys.hls_to_rgb(hue, 0.46 if number % 2 else 0.54, 0.78)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def class_color(place: int) -> str:
    """`#rrggbb` of the class at this place of the list (Okabe and Ito 2008: told apart by colour-blind readers, too)."""
    colors = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1", "#a6761d")
    return colors[place % len(colors)]


def rgb(color: str) -> tuple[int, int, int]:
    """`#rrggbb` → bytes."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)
