"""A comparison for the terminal: a table a group."""

from __future__ import annotations

from collections.abc import Collection

from rich.markup import escape
from rich.table import Table

from b23d.stages.workbench.report.comparison import COLUMNS, keypoint_lines, part_lines
from b23d.stages.workbench.results.comparing import Comparison

LONGEST = 110


def comparison_tables(comparison: Comparison, labels: Collection[str] | None = None) -> list[Table]:
    """One a group: the figures of its systems, why one has none, and the paper's printed rows. `labels`: only these
    systems."""
    tables = []
    for name, systems in comparison.groups().items():
        chosen = [system for system in systems if labels is None or system.label in labels]
        if not any(system.group for system in chosen) and any(system.group for system in systems):
            continue  # references alone
        if any(system.kind == "parts" for system in chosen):
            parts = part_lines(chosen)
            tables.append(_table(f"{name} (IoU in %)", [*parts["classes"], "average"], parts["lines"]))
        else:
            tables.append(_table(f"{name} (mean over classes)", list(COLUMNS), keypoint_lines(chosen)))
    return tables


def _table(title: str, columns: list[str], lines: list[dict]) -> Table:
    table = Table(title=escape(title), title_justify="left")
    table.add_column("system", overflow="fold")
    for column in columns:
        table.add_column(escape(column), justify="right", overflow="fold")
    missing = [line for line in lines if not line["cells"]]
    for line in lines:
        if line["cells"]:
            style = "dim italic" if line.get("quoted") else "bold" if line.get("reference") else None
            table.add_row(escape(line["name"]), *line["cells"], style=style)
    if missing:
        table.caption = escape("\n".join(f"{line['name']}: {_short(line['reason'])}" for line in missing))
        table.caption_justify = "left"
    return table


def _short(reason: str) -> str:
    return reason if len(reason) <= LONGEST else f"{reason[:LONGEST]}…"
