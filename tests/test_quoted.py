"""Quoted figures agree with what the paper says of them."""

from __future__ import annotations

import numpy as np
import pytest

from b23d.stages.scoring.quoted import (
    B2_3D,
    CURVES,
    HUNGARIAN,
    PART_CLASSES,
    PARTS,
    STATEMENTS,
    THRESHOLDS,
    statements_of,
)


def test_curves_rise_and_are_marked_as_quoted() -> None:
    for curve in CURVES:
        assert len(curve.iou) == len(THRESHOLDS) and (np.diff(curve.iou) > 0).all() and "quoted" in curve.quoted
    assert all("quoted" in entry.quoted for entry in (*PARTS, *STATEMENTS))


def test_the_gain_over_hungarian_is_the_papers() -> None:
    assert np.mean(np.array(B2_3D.iou) / HUNGARIAN.iou) - 1 == pytest.approx(0.37, abs=0.03)


def test_part_means_are_the_means_of_their_classes() -> None:
    for row in PARTS:
        assert len(row.iou) == len(PART_CLASSES) and np.mean(row.iou) == pytest.approx(row.mean, abs=0.06), row.system


def test_dino_leads_in_nine_of_fifteen_classes() -> None:
    earlier = np.array([row.iou for row in PARTS if row.system in ("IDC", "CPAE", "NCP")]).max(axis=0)
    dino = np.array(next(row.iou for row in PARTS if row.system == "DINO"))
    assert (dino > earlier).sum() == 9 and (dino - earlier).max() == pytest.approx(18.3)


def test_statements_are_found_by_a_systems_name() -> None:
    assert [said.systems for said in statements_of("SAM ViT-H")] == [("SAM",)]
    assert [said.systems for said in statements_of("DINOv2 ViT-S/14")] == [("DINOv2 ViT-S",)]
    assert statements_of("EfficientNet-Lite0") == statements_of("SHOTS") == statements_of("farthest") == []
