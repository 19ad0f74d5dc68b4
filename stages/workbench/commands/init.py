"""`b23d init`: from a folder of shapes to a run file."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from b23d.stages.workbench.results.standing import mixed_line

if TYPE_CHECKING:
    from b23d.stages.datasets.survey import ClassSurvey, Survey

SHOWN = 5
"""Problems, and classes without annotations, that are listed."""


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of meshes or clouds.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="RUN", show_default="runs/<folder>.toml where there is a runs/, else <folder>.toml"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a run file that is there.")] = False,
) -> None:
    """Look at a folder of meshes or clouds, say what is in it, and write a run file for it.

    Read as they are: shapes in the folder itself or in a folder for each class, ShapeNet's, KeypointNet's and
    ShapeNetPart's layouts, and keypoints in keypoints.json.
    """
    from b23d.stages.datasets.survey import survey
    from b23d.stages.workbench.results.run_file_text import run_file_text, run_name, summary

    console = Console()
    console = console if console.is_terminal else Console(width=120)
    path = out or _place(folder, run_name(folder))
    if path.exists() and not force:
        raise FileExistsError(f"init: expected no file at {path}, got one; --force replaces it, -o writes another")
    with console.status("looking") as status:
        found = survey(folder, lambda done, total: status.update(f"measuring {done}/{total} shapes"))
    console.print(f'{folder}: {summary(found)}; read as kind = "{found.dataset.kind}"', highlight=False, markup=False)
    console.print(_table(found))
    for line in remarks(found):
        console.print(f"[yellow]![/] {escape(line)}", highlight=False, soft_wrap=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(run_file_text(found, run_name(path.with_suffix("")), path.parent), encoding="utf-8")
    console.print(f"wrote {path}", highlight=False, soft_wrap=True, markup=False)
    for line in next_steps(found, path):
        console.print(line, highlight=False, soft_wrap=True, markup=False)


def remarks(found: Survey) -> list[str]:
    """What may surprise: shapes that cannot be used, an up axis that is not +y, or not the same for a whole class."""
    lines = [f"set aside: {problem}" for problem in found.problems[:SHOWN]]
    if len(found.problems) > SHOWN:
        lines.append(f"… and {len(found.problems) - SHOWN} more")
    for each in found.classes:
        if each.up is not None and each.up.axis not in (None, "y"):
            lines.append(
                f"{each.name}: up looks like {each.up.axis} ({each.up.votes} of {each.up.asked} stand on it), and so "
                "says dataset.up in the run file: look at one, and change it if not"
            )
        if each.up is not None and each.up.mixed:
            lines.append(mixed_line(each.name, each.up))
    return lines


def next_steps(found: Survey, path: Path) -> list[str]:
    at = shlex.quote(str(path))
    if found.annotated:
        lines = [f"next: b23d run {at}"]
        lacking = [each.name for each in found.classes if not each.annotated]
        if lacking:
            names = ", ".join(lacking[:SHOWN]) + (" …" if len(lacking) > SHOWN else "")
            lines.append(f"      without annotations, {names} get features and no keypoints: b23d annotate {at}")
        return lines
    if found.dataset.kind == "shapenetpart":
        return [f"next: b23d run {at} --set 'outputs=[\"score_parts\"]'   # transfers part labels"]
    return [
        f"next: b23d annotate {at}   # click keypoints on a few shapes of each class",
        f"      b23d run {at}",
    ]


def _place(folder: Path, name: str) -> Path:
    """`runs/<name>.toml` where there is a runs/, else beside the folder."""
    if Path("runs").is_dir():
        return Path("runs", f"{name}.toml")
    path = folder.resolve().with_name(f"{name}.toml")
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def _table(found: Survey) -> Table:
    table = Table("class", "shapes", "formats", "annotated", "longest side", "x × y × z", "up (guess)")
    for each in found.classes:
        formats = ", ".join(f"{count} {suffix[1:]}" for suffix, count in each.formats.most_common())
        box = "·" if each.box is None else " × ".join(f"{side:.3g}" for side in each.box)
        cells = [each.name, str(each.shapes), formats, str(len(each.annotated) or "·"), _range(each), box, _up(each)]
        table.add_row(*map(escape, cells))
    return table


def _range(each: ClassSurvey) -> str:
    if each.sizes is None:
        return "·"
    low, high = each.sizes
    return f"{low:.3g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} … {high:.3g}"


def _up(each: ClassSurvey) -> str:
    if each.up is not None and each.up.mixed:
        return "mixed: " + ", ".join(f"{axis} ({count})" for axis, count in each.up.mixed)
    if each.up is None or each.up.axis is None:
        return "unclear"
    return f"{each.up.axis} ({each.up.votes} of {each.up.asked})"
