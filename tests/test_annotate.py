"""Annotating by hand: a run uses what was saved, and says which shapes it still needs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.dataset import Leaf, Shape
from b23d.pipeline.run import Run
from b23d.schemas.runfile import Shots
from b23d.stages.datasets.annotations import load_keypoints
from b23d.stages.workbench.annotate.needed import beside, class_needs, next_needed
from b23d.stages.workbench.annotate.session import Session
from b23d.stages.workbench.annotate.walk import Walk
from tests.small_runs import make_boxes

plug_in()


def session(run: Run, name: str, keypoints: Path | None = None) -> Session:
    return Session(run.config.dataset, run.shapes, name, keypoints)


def click(at: Session) -> dict[str, Any]:
    """A click from above."""
    found = at.hit([0.1, 3, 0.07], [0, -1, 0])
    assert found is not None
    return found


def as_json(at: Session) -> list[dict[str, Any]]:
    """The shape's keypoints as a page sends them back unchanged."""
    return [{"id": k["id"], "was": k["id"], "hit": None} for k in at.page()["keypoints"]]


def test_a_new_annotation_is_used_by_the_next_plan(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 4)
    file = tmp_path / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    file.write_text(json.dumps(entries[:3]))
    before = Run.load(path).plan()
    assert not any(node.stage == "score" and node.shape == "box/b3" for node in before.nodes.values())
    at = session(Run.load(path), "box/b3")
    page = at.page()
    assert [line["id"] for line in page["ids"]] == list(range(8)) and page["peers"] == 3 and page["keypoints"] == []
    assert len(at.reference("box/b1")["keypoints"]) == 8
    at.save([{"id": 4, "was": None, "hit": click(at)}], page["given"])
    saved = json.loads(file.read_text())
    assert saved[:3] == entries[:3] and saved[3]["class_id"] == "box" and saved[3]["keypoints"][0]["semantic_id"] == 4
    after = Run.load(path)
    keypoints = next(s for s in after.shapes if s.name == "box/b3").leaves["keypoints"]
    assert keypoints.values["keypoints"][0]["xyz"] == saved[3]["keypoints"][0]["xyz"]
    assert after.plan().nodes.keys() != before.nodes.keys(), "the shots or the scores have new addresses"


def test_saving_twice_and_moving(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 2)
    at = session(Run.load(path), "box/b0")
    keypoints = as_json(at)
    moved = click(at)
    keypoints[2]["hit"] = moved
    given = at.save(keypoints, at.page()["given"])["given"]
    at.save(as_json(at)[:-1], given)
    entry = json.loads((tmp_path / "shapes" / "keypoints.json").read_text())[0]
    assert len(entry["keypoints"]) == 7 and entry["keypoints"][2]["xyz"] == moved["xyz"] and entry["model_id"] == "b0"


def test_published_and_exact_annotations_are_refused(tmp_path: Path) -> None:
    run = tmp_path / "p.toml"
    run.write_text('name = "p"\n[dataset]\nkind = "procedural"\nclasses = ["mug"]\ncount = 4\n')
    loaded = Run.load(run)
    name = loaded.shapes[0].name
    with pytest.raises(ValueError, match=r"exact by construction.*--keypoints FILE"):
        session(loaded, name)
    at = session(loaded, name, tmp_path / "mine.json")
    kept = as_json(at)
    assert kept, "starts from what the data set knows"
    at.save(kept, at.page()["given"])
    assert len(json.loads((tmp_path / "mine.json").read_text())[0]["keypoints"]) == len(kept)
    result = CliRunner().invoke(app, ["annotate", str(run), name, "--no-browser"])
    assert isinstance(result.exception, ValueError) and "procedural" in str(result.exception)


def test_unknown_shapes_get_a_hint(tmp_path: Path) -> None:
    run = Run.load(make_boxes(tmp_path, 2))
    with pytest.raises(KeyError, match="did you mean 'box/b1'"):
        session(run, "b1")


def made(category: str, ids: str, annotated: str = "") -> list[Shape]:
    leaf = Leaf(load_keypoints)
    return [Shape(id, category, {"keypoints": leaf} if id in annotated else {}) for id in ids]


def needs(shapes: list[Shape], **shots: Any) -> Any:
    return class_needs(shapes, Shots(**shots), lambda shape: "keypoints" in shape.leaves)


def test_the_next_shape_is_the_one_a_run_needs() -> None:
    shapes = made("box", "abc", "a") + made("cup", "d")
    assert next_needed(needs(shapes, count=2)) == "box/b"
    assert next_needed(needs(shapes, count=1)) == "cup/d", "the class that wants shots goes first"
    assert next_needed(needs(shapes, ids={"box": ["c"]})) == "box/c"
    assert next_needed(needs(shapes[:2], count=1)) == "box/b", "further annotations give scores"
    with pytest.raises(ValueError, match="name one to change"):
        next_needed(needs(shapes[:1]))
    assert needs(shapes, count=2)[0].told == "box: 1 of 2 shots annotated"
    assert needs(made("box", "abc", "ab"), ids={"box": ["c", "b"]})[0].told == "box: 1 of 2 shots annotated"
    assert needs(made("box", "abc", "abc"), count=2)[0].told == "box: 2 of 2 shots annotated, 1 more annotated"


@pytest.mark.parametrize("count", [1, 2, 3, 9])
@pytest.mark.parametrize("annotated", ["", "a", "bd", "abcdef"])
def test_a_walk_meets_every_shape_that_is_needed(annotated: str, count: int) -> None:
    shapes = made("box", "abc", annotated) + made("cup", "def", annotated)
    found = needs(shapes, count=count)
    wanted = {name for each in found for name in each.needed}
    for start in [shape.name for shape in shapes]:
        seen, at = {start}, beside(found, start)[1]
        while at is not None and at not in seen:
            seen.add(at)
            at = beside(found, at)[1]
        assert wanted <= seen, "whichever shape it starts from"
        assert wanted >= seen - {start} or not wanted, "and stops at no other on the way"
        assert beside(found, start)[0] != start != beside(found, start)[1]


def test_a_walk_goes_on_from_what_was_saved(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 4)
    file = tmp_path / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    entries[0]["keypoints"][2]["name"] = "near corner"
    file.write_text(json.dumps(entries[:1]))
    walk = Walk(Run.load(path))
    page = walk.page()
    assert page["name"] == "box/b1" and page["ids"][2] == {"id": 2, "count": 1, "name": "near corner"}
    assert page["walk"] == {"previous": "box/b0", "next": "box/b2", "told": "box: 1 of 2 shots annotated"}
    hit = click(walk.at())
    saved = walk.save(keypoints=[{"id": 2, "was": None, "hit": hit, "name": "my corner"}], given=page["given"])
    assert saved["walk"] == {"previous": "box/b0", "next": "box/b2", "told": "box: 2 of 2 shots annotated"}
    after = walk.page("box/b2")
    assert after["peers"] == 2 and after["ids"][2]["count"] == 2, "what was saved stands beside"
    (own,) = walk.page("box/b1")["keypoints"]
    assert own["at"]["xyz"] == hit["xyz"] and own["name"] == "my corner"
    named = walk.at("box/b2").reference("box/b0")["keypoints"][2]
    assert named["name"] == "near corner" and named["at"]["xyz"] == entries[0]["keypoints"][2]["xyz"]


def test_a_walk_counts_what_another_file_has(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    own = tmp_path / "shapes" / "keypoints.json"
    mine = tmp_path / "mine.json"
    mine.write_text(json.dumps([{**json.loads(own.read_text())[0], "class_id": "box"}]))
    own.unlink()
    walk = Walk(Run.load(path), keypoints=mine)
    assert walk.first == "box/b1" and walk.around("box/b1")["told"] == "box: 1 of 2 shots annotated"
