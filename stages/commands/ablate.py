"""`b23d ablate`: from one setting of the stages to another, one field at a time, each step scored; all that is unchanged is re-used."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from pipeline.config import load_config
from pipeline.run import Run

if TYPE_CHECKING:
    from schemas.scores import ScoreTable


@dataclass(frozen=True)
class Step:
    """One field of one stage, changed. The first step changes nothing: it is where we come from."""

    field: str
    before: Any
    after: Any
    overrides: tuple[str, ...]
    """What sets every differing field as it stands after this step."""


def steps(origin: Path, goal: Path, run: Path) -> list[Step]:
    """The steps from the stages' params of one run file to those of another, in dataflow order of `run`."""
    before, after = load_config(origin), load_config(goal)
    order = [name for name in load_config(run).stages if name in before.params and name in after.params]
    changes: list[tuple[str, Any, Any]] = []
    for stage in order:
        old, new = before.params[stage].hashed(), after.params[stage].hashed()
        changes += [(f"stages.{stage}.{key}", old[key], new[key]) for key in old if old[key] != new[key]]
    found = []
    for count in range(len(changes) + 1):
        values = [(field, new if i < count else old) for i, (field, old, new) in enumerate(changes)]
        field, old, new = changes[count - 1] if count else (origin.stem, None, None)
        found.append(Step(field, old, new, tuple(f"{name}={json.dumps(value)}" for name, value in values if value is not None)))
    return found


def ablate(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file: its data set, shots and encoder are used.")],
    origin: Annotated[str, typer.Option("--from", help="Run file, or the name of one beside RUN.")] = "released",
    goal: Annotated[str, typer.Option("--to", help="Run file, or the name of one beside RUN.")] = "corrected",
    set: Annotated[list[str], typer.Option("--set", metavar="a.b=value", help="Fixed throughout.")] = [],  # noqa: B006
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    workers: Annotated[int | None, typer.Option(min=0)] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1)] = None,
) -> None:
    """Score the way from one run file to another, a field at a time: a table, and a plot in the run's folder."""
    from stages.commands.scores import run_scores

    console, found = Console(), []
    for step in steps(_beside(run, origin), _beside(run, goal), run):
        loaded = Run.load(run, [*step.overrides, *set], store)
        with console.status(f"{step.field}: running"):
            report = loaded.execute(workers, limit=limit)
        table = run_scores(loaded)
        ran = ", ".join(sorted({outcome.stage for outcome in report.done}, key=list(loaded.config.stages).index)) or "nothing"
        change = step.field if step.before is None and step.after is None else f"{step.field}: {step.before} → {step.after}"
        found.append((change, table))
        console.print(f"[dim]{change}: {ran} in {report.seconds:.0f} s[/]", highlight=False)
    console.print(ablation_table(found))
    path = run.parent / load_config(run, set).file.name / "ablation.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(ablation_plot(found))
    console.print(f"plot: {path}", highlight=False)


def ablation_table(found: list[tuple[str, ScoreTable]]) -> Table:
    """Mean over classes after each step: IoU at .02, .05, .10, AUC with sd, labelled PCK, and what the step changed in AUC."""
    table = Table(title="ablation (mean over classes)", title_justify="left")
    for column in ("step", "IoU .02", ".05", ".10", "AUC", "Δ AUC", "PCK .10"):
        table.add_column(column, justify="left" if column == "step" else "right", overflow="fold")
    last: float | None = None
    for change, scores in found:
        mean = scores.mean
        at = [f"{mean.iou.mean[i]:.3f}" for i in (2, 5, 10)]
        delta = "" if last is None else f"{mean.auc.mean - last:+.3f}"
        table.add_row(change, *at, f"{mean.auc.mean:.3f} ± {mean.auc.sd:.3f}", delta, f"{mean.pck.mean[10]:.3f}")
        last = mean.auc.mean
    return table


def ablation_plot(found: list[tuple[str, ScoreTable]]) -> str:
    """The same as one self-contained HTML page: a bar of AUC a step, with the sd over draws."""
    import plotly.graph_objects as go

    names = [change for change, _ in found]
    auc = [scores.mean.auc for _, scores in found]
    figure = go.Figure(go.Bar(x=[a.mean for a in auc], y=names, orientation="h", error_x={"array": [a.sd for a in auc]}))
    height = 120 + 34 * len(found)
    figure.update_layout(xaxis_title="AUC of IoU, 0 … .10", yaxis={"autorange": "reversed"}, margin={"l": 360}, height=height)
    return str(figure.to_html(include_plotlyjs=True))


def _beside(run: Path, name: str) -> Path:
    path = Path(name)
    return path if path.suffix == ".toml" else run.parent / f"{name}.toml"
