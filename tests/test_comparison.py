"""A comparison: variants in turn, one of them failing; the page holds every system, and what is quoted is marked as
quoted."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import Member, members
from b23d.schemas.scores import ClassScores, Curve, PresenceScores, ScoreTable, Spread
from b23d.stages.scoring.quoted import B2_3D, HUNGARIAN, PART_CLASSES, PARTS
from b23d.stages.workbench.commands.sweep import choose
from b23d.stages.workbench.report.comparison import comparison_curves, keypoint_lines, part_lines, render_comparison
from b23d.stages.workbench.report.terminal import comparison_tables
from b23d.stages.workbench.results.comparing import Comparison, System, compare
from b23d.stages.workbench.results.scores import spread
from tests.small_runs import FAST

plug_in()
ROOT = Path(__file__).parents[1]
PAPER = ROOT / "runs" / "paper-table.toml"
RUN = """
name = "tiny"
[dataset]
kind = "procedural"
classes = ["chair", "mug"]
count = 4
[shots]
count = 2
draws = [0, 1]
[store]
root = "{store}"
[variants]
"B2-3D" = {{}}
"baselines/FPS" = {{"feeds.optimize" = "detect", "stages.calibrate.method" = "farthest"}}
"encoders/SAM gone" = {{"stages.extract.encoder" = "sam-vit-base", "stages.extract.weights" = "nowhere"}}
"assignment/Hungarian" = {{"stages.optimize.method" = "hungarian"}}
"shots/5 shots" = {{"shots.count" = 5}}
"parts/EfficientNet-Lite0" = {{outputs = ["score_parts"], "shots.count" = 1}}
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """The run file after `b23d sweep`, and what that printed."""
    folder = tmp_path_factory.mktemp("comparison")
    path = folder / "tiny.toml"
    path.write_text(RUN.format(store=folder / "store") + FAST.replace("count = 256", "count = 128"))
    done = CliRunner().invoke(app, ["sweep", str(path), "--workers", "0"])
    assert done.exit_code == 0, done.output
    yield path, done.output


def test_a_system_that_cannot_run_is_named_and_the_rest_goes_on(swept: tuple[Path, str]) -> None:
    _, printed = swept
    assert re.search(r"SAM gone: unavailable: .*expected stages\.extract\.weights to be a folder", printed)
    assert re.search(r"FPS: ran .*detect", printed) and re.search(r"5 shots: .*ran nothing", printed)
    for title in ("baselines", "encoders", "assignment", "parts"):
        assert title in printed


def test_what_is_stored_is_compared_on_the_same_targets(swept: tuple[Path, str]) -> None:
    path, _ = swept
    found = compare(path, members(load_config(path)))
    by_name = {system.name: system for system in found.systems}
    ours, farthest, gone, many = (by_name[name] for name in ("B2-3D", "FPS", "SAM gone", "5 shots"))
    assert (
        ours.scores is not None
        and farthest.scores is not None
        and ours.scores.mean.targets == farthest.scores.mean.targets
    )
    assert found.targets == 8 and found.left_out == 0 and ours.seconds is not None and 0 < ours.seconds < 60
    assert not gone.shown and "nowhere" in gone.reason
    assert not many.shown and "expected" in many.reason  # four shapes of a class are too few for five shots
    parts = by_name["EfficientNet-Lite0"].parts
    assert parts is not None and set(parts.classes) == {"chair", "mug"} and 0 < parts.mean.mean <= 1
    assert [system.name for system in found.groups()["assignment"]] == ["B2-3D", "Hungarian"]
    assert [system.name for system in found.groups()["parts"]] == ["EfficientNet-Lite0"], (
        "keypoints are no reference for parts"
    )


def test_the_page_holds_every_system_and_marks_what_is_quoted(swept: tuple[Path, str]) -> None:
    path, _ = swept
    page = (path.parent / "tiny" / "comparison.html").read_text()
    body = page[page.index("<main>") : page.index("</main>")]
    for name in ("B2-3D", "FPS", "SAM gone", "Hungarian", "5 shots", "EfficientNet-Lite0"):
        assert name in body
    rows = re.findall(r"<tr class=\"([a-z]*)\"><?\s*<td>(.*?)</td>", body.replace("\n", ""))
    quoted = [name for kind, name in rows if kind == "quoted"]
    assert any(name.startswith("Hungarian (paper)") for name in quoted) and any(
        name.startswith("DINO (paper)") for name in quoted
    )
    assert all(("(paper)" in name) == (kind == "quoted") for kind, name in rows)
    assert any(kind == "unavailable" and name.startswith("SAM gone") for kind, name in rows)
    assert "below EfficientNet, as CLIP is" in body and "FSKD" in body
    assert not re.search(r"(src|href)=\"(?!#|data:)", page.split('id="plotly"')[0]), "self-contained"


def test_report_writes_the_same_page_from_what_is_stored(swept: tuple[Path, str]) -> None:
    path, _ = swept
    made = path.parent / "tiny" / "comparison.html"
    before, made_json = made.read_text(), made.with_suffix(".json").read_text()
    made.unlink()
    done = CliRunner().invoke(app, ["report", str(path), "--details", "0"])
    assert done.exit_code == 0 and "comparison.html" in done.output.replace("\n", ""), done.output
    without_time = re.compile(r"made [0-9-]+ [0-9:]+ UTC")
    assert without_time.sub("", made.read_text()) == without_time.sub("", before)
    assert made.with_suffix(".json").read_text() == made_json
    entries = json.loads(made_json)
    assert [entry["system"] for entry in entries][:2] == ["B2-3D", "FPS"] and entries[1]["scores"]["classes"]


def test_parts_are_printed_after_a_run(swept: tuple[Path, str]) -> None:
    path, _ = swept
    done = CliRunner().invoke(
        app, ["run", str(path), "--workers", "0", "--set", 'outputs=["score_parts"]', "--set", "shots.count=1"]
    )
    assert done.exit_code == 0 and "tiny: parts" in done.output, done.output
    assert json.loads((path.parent / "tiny" / "parts.json").read_text())["classes"]


def test_why_a_system_has_no_figures_is_shown_as_it_is() -> None:
    """It names a table of the run file, in brackets."""
    reason = "run file x.toml: [variants.a]: method: expected one of 'b', got 'c'"
    system = System("[bold]enc/[red]a", "[bold]enc", reason=reason)
    (table,) = comparison_tables(Comparison([system]))
    printed = io.StringIO()
    Console(file=printed, width=200).print(table)
    assert f"[red]a: {reason}" in printed.getvalue() and "[bold]enc" in printed.getvalue()


def test_series_members_are_chosen_by_globs() -> None:
    listed = [Member(label, ()) for label in ("B2-3D", "encoders/a", "encoders/b", "beta/1")]
    assert [m.label for m in choose(listed, ["encoders/*", "B2*"], ["*/b"])] == ["B2-3D", "encoders/a"]
    with pytest.raises(ValueError, match="expected to leave one of B2-3D"):
        choose(listed, ["x"], [])


# --- the paper's table ------------------------------------------------------------------------------------------------

LISTED = members(load_config(PAPER))


@pytest.mark.parametrize("member", LISTED, ids=[member.label for member in LISTED])
def test_every_variant_of_the_papers_table_is_valid(member: Member) -> None:
    config = load_config(PAPER, member.overrides)
    assert ("score_parts" if member.label.startswith("parts/") else "score") in config.stages
    if "detect" in config.stages:
        assert "extract" not in config.stages, "a detector's seconds are its own"


def test_the_papers_table_has_the_papers_systems_and_other_data_sets() -> None:
    names = {member.label.partition("/")[2] or member.label for member in LISTED}
    wanted = {"B2-3D", "FPS", "ISS", "HARRIS-3D", "SIFT-3D", "trained head", "CLIP ViT-L/14", "SAM ViT-H",
              "EfficientNet B4", "DINOv2 ViT-g/14", "HKS", "WKS", "SHOT", "1 shot", "5 shots", "retrieval", "texture",
              "nearest neighbour", "Hungarian", "discrete", "softmax", "α = 0", "β = 2"}  # fmt: skip
    assert wanted <= names
    keypointnet = load_config(PAPER, ['dataset={kind = "keypointnet", root = "x", classes = ["airplane"]}'])
    assert keypointnet.dataset.kind == "keypointnet" and len(members(keypointnet)) == len(LISTED)


def test_external_systems_in_comments_are_valid_once_their_comment_is_gone(tmp_path: Path) -> None:
    text = PAPER.read_text()
    shown = re.sub(r'^# ("baselines/)', r"\1", text, flags=re.M).replace('base = "', f'base = "{PAPER.parent}/')
    table = '[dataset]\nkind = "keypointnet"\nroot = "x"\nclasses = ["airplane"]\n\n[shots]'
    shown = re.sub(r"\[dataset\].*?\n\[shots\]", table, shown, flags=re.S)
    path = tmp_path / "paper-table.toml"
    path.write_text(shown)
    listed = members(load_config(path))
    added = {member.label for member in listed} - {member.label for member in LISTED}
    assert added == {f"baselines/{name}" for name in ("D3Feat", "USIP", "UKPGAN", "FSKD")}
    for member in listed:
        if member.label in added:
            assert "import_predictions" in load_config(path, member.overrides).stages


# --- the page without a run -------------------------------------------------------------------------------------------


def scores(level: float) -> ScoreTable:
    thresholds = [i / 100 for i in range(11)]
    curve = Curve(mean=[level * t * 10 for t in thresholds], sd=[0.01] * 11)
    spread = Spread(mean=level / 2, sd=0.01)
    row = ClassScores(
        targets=4, draws=2, thresholds=thresholds, iou=curve, auc=spread, pck=curve, symmetric_pck=curve,
        either_front_pck=curve, one_to_one=curve,
        presence=PresenceScores(precision=spread, recall=spread), ceiling=1.0, annotation_files=[],
    )  # fmt: skip
    return ScoreTable(run="x", protocol="made up", classes={"chair": row}, mean=row)


def test_a_group_of_parts_that_has_none_shows_the_papers() -> None:
    systems = [
        System("B2-3D", "", scores=scores(0.9)),
        System("parts/x", "parts", kind="parts", reason="no part labels"),
    ]
    assert Comparison(systems).groups()["parts"] == systems[1:]
    lines = part_lines(systems[1:])
    assert (
        lines["classes"] == list(PART_CLASSES)
        and lines["lines"][0]["cells"] == []
        and len(lines["lines"]) == 1 + len(PARTS)
    )


def many() -> list[System]:
    named = [System(f"encoders/<{i}>", "encoders", scores=scores(0.5 + i / 40)) for i in range(12)]
    return [System("B2-3D", "", scores=scores(0.9)), *named, System("encoders/Hungarian", "encoders", reason="not run")]


def test_curves_are_told_apart_and_the_papers_are_dashed_grey() -> None:
    figure = comparison_curves(many())
    drawn: list[Any] = [trace for trace in figure.data if trace.showlegend is not False]
    looks = {(trace.line.color, trace.line.dash) for trace in drawn}
    assert len(looks) == len(drawn) == 12 + 1 + 2
    quoted = [trace for trace in drawn if "(paper)" in trace.name]
    assert [tuple(trace.y) for trace in quoted] == [B2_3D.iou, HUNGARIAN.iou] and {
        trace.line.dash for trace in quoted
    } == {"dash", "dot"}
    assert drawn[12].name == "B2-3D" and drawn[12].line.width > drawn[0].line.width


def test_lines_say_what_the_paper_says_and_nothing_more() -> None:
    lines = keypoint_lines([System("a/SHOT", "a", reason="not run"), System("a/mine", "a", scores=scores(1))])
    assert lines[0]["says"] == ["HKS is the best of the three, and only as good as FPS"] and lines[1]["says"] == []
    assert [line["name"] for line in lines if line.get("quoted")] == ["B2-3D (paper)"]
    assert lines[1]["cells"][:4] == [".20", ".50", "1.00", ".500 ± .010"]


def test_names_are_escaped() -> None:
    page = render_comparison(load_config(PAPER), Comparison(many(), targets=8))
    assert "&lt;3&gt;" in page and "<3>" not in page


def test_a_run_file_without_variants_compares_nothing(tmp_path: Path) -> None:
    assert members(Run.load(ROOT / "runs" / "demo.toml").config) == []
    assert Comparison([]).groups() == {}


def test_one_draw_tells_no_spread() -> None:
    assert spread(0.5, 0.0, 1) == "0.500" and spread(0.5, 0.01, 2) == "0.500 ± 0.010"
