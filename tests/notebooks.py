"""Notebooks run as plain Python, cell after cell in one namespace; the value of a cell's last line is its output.

`python -m tests.notebooks` runs runs/tour.ipynb and writes its outputs into it. Done by hand, not by nbclient: a kernel
would bring thirty packages for the sake of one notebook.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

TOUR = Path(__file__).parents[1] / "runs" / "tour.ipynb"
Cell = dict[str, Any]


def run_notebook(path: Path, folder: Path) -> list[Cell]:
    """Every cell with its outputs, run in `folder`. Raises what a cell raises, with the cell's text as a note."""
    cells: list[Cell] = json.loads(path.read_text())["cells"]
    namespace: dict[str, Any] = {"__name__": "__main__"}
    before = Path.cwd()
    os.chdir(folder)
    try:
        for count, cell in enumerate((c for c in cells if c["cell_type"] == "code"), 1):
            cell["execution_count"] = count
            cell["outputs"] = _run("".join(cell["source"]), namespace)
    finally:
        os.chdir(before)
    return cells


def _run(source: str, namespace: dict[str, Any]) -> list[Cell]:
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    try:
        with contextlib.redirect_stdout(printed):
            exec(compile(tree, "cell", "exec"), namespace)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), "cell", "eval"), namespace)
    except Exception as error:
        error.add_note(f"in the cell\n{source}")
        raise
    outputs: list[Cell] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue().splitlines(True)})
    if value is not None:
        data = {"text/plain": repr(value).splitlines(True)}
        if hasattr(value, "_repr_html_") and (html := value._repr_html_()):
            data["text/html"] = html.splitlines(True)
        outputs.append({"output_type": "execute_result", "execution_count": None, "metadata": {}, "data": data})
    return outputs


def write(path: Path, cells: list[Cell]) -> None:
    notebook = json.loads(path.read_text())
    for cell in cells:
        for output in cell.get("outputs", []):
            if "execution_count" in output:
                output["execution_count"] = cell["execution_count"]
    path.write_text(json.dumps({**notebook, "cells": cells}, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    write(TOUR, run_notebook(TOUR, Path(sys.argv[1] if len(sys.argv) > 1 else TOUR.parent)))
