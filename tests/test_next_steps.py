"""What a run proposes to do next works as it stands: of the same run, pasted into a shell; and helps."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pandas as pd
import pytest
import trimesh

from b23d.pipeline.inspection.listing import list_shapes
from b23d.pipeline.inspection.proposing import proposed
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.records.history import records
from b23d.pipeline.run import Run
from b23d.pipeline.store import Store
from tests.small_runs import b23d, make_boxes

DISCRETE = "stages.optimize.method=discrete"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A class with shots beside one that nobody annotated, in a folder whose name has to be quoted; run once."""
    folder = tmp_path_factory.mktemp("my shapes")
    path = make_boxes(folder, 4)
    (folder / "shapes" / "mugs").mkdir()
    for i in range(2):
        mug = trimesh.creation.cylinder(radius=0.3 + 0.1 * i, height=1, sections=16)
        mug.export(folder / "shapes" / "mugs" / f"mug{i}.ply")
    b23d("run", str(path), "--workers", "0", "--set", DISCRETE)
    return folder


def next_lines(output: str) -> list[str]:
    """The commands below "next:", without what they give."""
    block = re.search(r"^next: .*(?:\n      b23d .*)*", output, re.M)
    return [] if block is None else [line[6:].partition("   #")[0] for line in block[0].splitlines()]


def test_next_commands_are_of_the_same_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They carry overrides, store and selection, so that the keypoints are those that were just made."""
    monkeypatch.chdir(folder)
    again = b23d("run", str(folder / "boxes.toml"), "--set", DISCRETE, "--shape", "box/*", "--workers", "0")
    keypoints, report = next_lines(again)
    assert keypoints == shlex.join(
        ["b23d", "keypoints", str(folder / "boxes.toml"), "-o", "boxes.csv", "--set", DISCRETE, "--shape", "box/*"]
    )
    assert b23d(*shlex.split(keypoints)[1:]).startswith("wrote boxes.csv")
    assert set(pd.read_csv("boxes.csv")["class"]) == {"box"}
    assert report == shlex.join(["b23d", "report", str(folder / "boxes.toml"), "--set", DISCRETE])


def test_run_again_proposes_what_was_recorded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    store = Run.load(folder / "boxes.toml").store.url
    record = records(Store(store))[0].id
    first = next_lines(b23d("run", "--again", record, "--store", store, "--workers", "0"))[0]
    assert DISCRETE in shlex.split(first)
    Path("boxes.csv").unlink(missing_ok=True)
    assert b23d(*shlex.split(first)[1:]).startswith("wrote boxes.csv")


def test_a_proposal_is_parsed_as_it_was_given(folder: Path, tmp_path: Path) -> None:
    values = ['outputs=["optimize"]', f"dataset.keypoints={tmp_path}/it's here.json", "shots.draws=[0, 1]"]
    run = Run.load(folder / "boxes.toml", values, str(tmp_path / "another store"))
    selection = Selection(("box/*", "b1"), ("box",), 2, until="optimize", force=True)
    words = shlex.split(proposed("plan", run, selection=selection, taking=("shapes", "classes", "limit", "force")))
    said = [part for text in values for part in ("--set", text)]
    chosen = ["--shape", "box/*", "--shape", "b1", "--class", "box", "--limit", "2", "--force"]
    assert words == ["b23d", "plan", str(folder / "boxes.toml"), *said, "--store", run.store.url, *chosen]


def test_a_class_without_annotations_is_told_of(folder: Path, tmp_path: Path) -> None:
    path = str(folder / "boxes.toml")
    annotate = shlex.join(["b23d", "annotate", path, "--set", DISCRETE])
    line = f"! class mugs: no annotated shapes, so no keypoints are predicted; {annotate}"
    for told in (b23d("plan", path, "--set", DISCRETE), b23d("run", path, "--set", DISCRETE, "--workers", "0")):
        assert told.splitlines().count(line) == 1
    alone = b23d("run", path, "--class", "mugs", "--set", DISCRETE, "--workers", "0")
    assert line in alone and not any("keypoints" in command for command in next_lines(alone))
    for narrowed in (("--class", "box"), ("--until", "extract")):
        assert "no annotated shapes" not in b23d("plan", path, *narrowed)
    with pytest.raises(ValueError, match=r"got none: class mugs: no annotated shapes.*; b23d annotate "):
        b23d("keypoints", path, "--class", "mugs", "--set", DISCRETE)
    assert line.removeprefix("! ") in b23d(
        "keypoints", path, "-o", str(tmp_path / "k.csv"), "--set", DISCRETE
    )  # said beside those that there are


def test_where_nothing_can_be_predicted_annotating_is_proposed(tmp_path: Path) -> None:
    """Not the export of keypoints that cannot be there; nor does the export propose to run again."""
    path = make_boxes(tmp_path, 3)
    few = ["--set", "shots.count=9"]
    annotations = tmp_path / "shapes" / "keypoints.json"
    lacking = b23d("run", str(path), *few, "--workers", "0", code=1)
    assert next_lines(lacking) == [
        shlex.join(["b23d", verb, str(path), *few]) for verb in ("annotate", "report")
    ]  # features were made
    with pytest.raises(ValueError, match=r"got none: class box: expected 9 annotated shapes .*; b23d annotate "):
        b23d("keypoints", str(path), *few)
    lost = b23d("run", str(path), "--set", "shots.ids.box=['gone']", "--workers", "0", code=1)
    assert not any("annotate" in command for command in next_lines(lost))  # the run file is to be mended

    kept = annotations.read_text()
    annotations.unlink()
    assert next_lines(b23d("run", str(path), "--workers", "0", code=1))[0] == shlex.join(
        ["b23d", "annotate", str(path)]
    )
    with pytest.raises(ValueError, match=r"got none: no shape is annotated; b23d annotate "):
        b23d("keypoints", str(path))
    annotations.write_text(kept[:-9])  # cut off: annotating would not help
    broken = b23d("run", str(path), "--workers", "0", code=1)
    assert not any("annotate" in command or "keypoints" in command for command in next_lines(broken))


def test_a_shape_of_a_class_without_annotations_is_told_of(folder: Path) -> None:
    """In the list, where its keypoints are asked for, and in the report."""
    path = str(folder / "boxes.toml")
    lack = "class mugs: no annotated shapes, so no keypoints are predicted"
    listed = {row.shape: row.lack for row in list_shapes(Run.load(path))}
    assert {name for name, told in listed.items() if told == lack} == {"mugs/mug0", "mugs/mug1"}
    assert not any(told for name, told in listed.items() if name.startswith("box/"))
    for verb in ("show", "explain"):
        with pytest.raises(KeyError, match=lack):
            b23d(verb, path, "mugs/mug0", "optimize")
    shot = next(row.shape for row in list_shapes(Run.load(path)) if row.shot)
    with pytest.raises(KeyError, match="it is a shot of draw 0, and a shot has no prediction in its own draw"):
        b23d("show", path, shot, "optimize")
    b23d("report", path, "--set", DISCRETE)
    page = (folder / "boxes" / "report.html").read_text()
    assert lack in page and "2 unpredicted" in page and "all done" not in page


def test_a_class_with_too_few_shots_is_not_done_either(tmp_path: Path) -> None:
    run = Run.load(make_boxes(tmp_path, 3), ["shots.count=9"])
    assert all(row.lack.startswith("class box: expected 9 annotated shapes") for row in list_shapes(run))
    assert not any(row.lack for row in list_shapes(Run.load(run.config.path, ["outputs=['reweight']"])))
