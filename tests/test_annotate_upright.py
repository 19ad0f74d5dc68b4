"""Annotating shapes whose up axis is to be found: shown upright, written in the file's own frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import trimesh

from b23d.pipeline.run import Run
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.up_axis import UpAxis
from b23d.stages.datasets.procedural import generated
from b23d.stages.geometry.upright import Stance, stance
from b23d.stages.workbench.annotate.walk import Walk
from tests.test_up import AXIS, chairs

UPS: list[UpAxis] = ["y", "z", "-x", "-y"]


def test_shapes_are_shown_as_the_run_found_them_to_stand(tmp_path: Path) -> None:
    path = chairs(tmp_path, UPS)
    run = Run.load(path)
    assert run.execute(workers=0).ok
    walk = Walk(Run.load(path), "chair/2")
    for i, up in enumerate(UPS):
        shown, normal = walk.at(f"chair/{i}").pickable.drawn, run.artifact(f"chair/{i}", "normalize")
        assert isinstance(normal, NormalizedShape) and shown.up == up
        np.testing.assert_allclose(shown.vertices, normal.vertices, atol=1e-6)
    beside, other = walk.at("chair/2").reference("chair/1"), run.artifact("chair/1", "normalize")
    places = np.array([keypoint["at"]["xyz"] for keypoint in beside["keypoints"]])
    assert isinstance(other, NormalizedShape)
    np.testing.assert_allclose([keypoint["unit"] for keypoint in beside["keypoints"]], other.to_unit(places), atol=1e-6)


def test_a_click_from_above_is_written_where_it_is_in_the_file(tmp_path: Path) -> None:
    path = chairs(tmp_path, UPS)
    assert Run.load(path).execute(workers=0).ok
    at = Walk(Run.load(path), "chair/2").at()
    highest = at.pickable.drawn.vertices[at.pickable.drawn.vertices[:, 1].argmax()].astype(float)
    found = at.hit([highest[0], 3.0, highest[2]], [0.0, -1.0, 0.0], within=0.02)
    assert found is not None
    file = trimesh.load(tmp_path / "all/chair/2.ply", process=False)
    along = file.vertices @ AXIS["-x"]
    assert trimesh.proximity.closest_point_naive(file, [found["xyz"]])[1][0] < 1e-6
    assert np.array(found["xyz"]) @ AXIS["-x"] > along.max() - 0.02 * np.ptp(along)
    given = at.page()["given"]
    kept = [{"id": k["id"], "was": k["id"], "hit": None} for k in at.page()["keypoints"]]
    at.save([*kept, {"id": 99, "was": None, "hit": found}], given)
    entries = json.loads((tmp_path / "all" / "keypoints.json").read_text())
    saved = {k["semantic_id"]: k["xyz"] for k in next(e for e in entries if e["model_id"] == "2")["keypoints"]}
    assert saved[99] == found["xyz"] and len(saved) == len(kept) + 1


def test_before_a_run_a_flat_underside_tells_and_nothing_is_written(tmp_path: Path) -> None:
    path = chairs(tmp_path, ["z", "z", "z"], annotated=False)
    drawn = Walk(Run.load(path), "chair/2").at().pickable.drawn
    assert stance(generated("chair", 0, 2).vertices, generated("chair", 0, 2).faces) == Stance("y", signed=True)
    assert drawn.up == "z"
    assert not (tmp_path / "store").exists()


def test_a_shape_whose_axis_is_said_is_shown_by_it(tmp_path: Path) -> None:
    path = chairs(tmp_path, ["z", "z"])
    said = ['dataset.up={"*" = "auto", "chair/1" = "x"}']
    assert Walk(Run.load(path, said), "chair/1").at().pickable.drawn.up == "x"
