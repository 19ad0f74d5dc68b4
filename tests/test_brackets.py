"""Names with brackets are shown as they are, by every verb; help texts too. Rich would take them for styles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import typer.main
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.run import Run
from tests.small_runs import make_boxes
from tests.toy import make_toy

plug_in()
VERBS = sorted(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
NAMES = ("[red]x[/]", "[/]", "[link=file:x]y", "[bold", "a\\[b]", "[sweep]")


def plain(text: str) -> str:
    """As a terminal would say it: frames and line breaks left out."""
    return "".join(text.replace("│", "").replace("┃", "").split())


@pytest.mark.parametrize("verb", VERBS)
def test_help_is_shown_as_it_is_written(verb: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    told = CliRunner().invoke(app, [verb, "--help"])
    assert told.exit_code == 0, told.output
    command = next(c for c in app.registered_commands if (c.name or c.callback.__name__) == verb)  # type: ignore[union-attr]
    written = (command.callback.__doc__ or "").split("\n\n")[0]
    assert plain(written) in plain(told.output)
    click = typer.main.get_command(app).commands[verb]  # type: ignore[attr-defined]
    for param in click.params:
        if getattr(param, "help", None) and not getattr(param, "hidden", False):
            assert plain(param.help.replace("\\[", "["))[:40] in plain(told.output), param.name


def test_the_list_of_verbs_is_shown_as_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    told = plain(CliRunner().invoke(app, ["--help"]).output)
    for command in app.registered_commands:
        first = (command.callback.__doc__ or "").split(". ")[0].split("\n\n")[0]  # type: ignore[union-attr]
        assert plain(first)[:30] in told


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("toy")
    path = make_toy(folder, count=3)
    for i, name in enumerate(n for n in NAMES if "/" not in n):
        (folder / "numbers" / f"{name}.txt").write_text(f"{i} 1 2")
    (folder / "numbers" / "[bad].txt").write_text("-13")
    return path


def invoke(*arguments: str) -> str:
    told = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})
    assert told.exception is None or isinstance(told.exception, SystemExit), (arguments, told.exception)
    return told.output


def test_verbs_of_the_engine(toy: Path) -> None:
    run = str(toy)
    assert "toy/[bad]: numbers: expected none" in invoke("run", run, "--workers", "0")
    invoke("plan", run)
    for name in (n for n in NAMES if "/" not in n):
        shape = f"toy/{name}"
        assert plain(f"square of {shape}") in plain(invoke("show", run, shape, "square"))
        assert plain(f"square of {shape}") in plain(invoke("explain", run, shape, "square"))
    invoke("verify", run)
    told = CliRunner().invoke(app, ["show", run, "toy/[red]no[/]", "square"])
    assert "[red]no[/]" in str(told.exception)


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A class called `[red]x[`: the shape `[red]x[/]` is one whose file is called `]`."""
    folder = tmp_path_factory.mktemp("boxes")
    path = make_boxes(folder, 4)
    (folder / "shapes" / "box").rename(folder / "shapes" / "[red]x[")
    (folder / "shapes" / "[red]x[" / "b3.ply").rename(folder / "shapes" / "[red]x[" / "].ply")
    annotations = folder / "shapes" / "keypoints.json"
    annotations.write_text(annotations.read_text().replace('"b3"', '"]"'))
    Run.load(path).execute(workers=0)
    yield path


def test_verbs_of_the_workbench(boxes: Path) -> None:
    run = str(boxes)
    assert "[red]x[" in invoke("scores", run)
    assert plain("of [red]x[/]") in plain(invoke("show", run, "[red]x[/]", "normalize"))
    invoke("report", run)
    assert "[red]x[/]" in (boxes.parent / "boxes" / "report.html").read_text()
    assert "[red]x[" in invoke("diff", run, run)
