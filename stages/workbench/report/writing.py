"""From a run to its report on disk."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import B23dError
from b23d.pipeline.run import Run
from b23d.schemas.scores import ScoreTable
from b23d.stages.workbench.pictures.coloring import class_basis, feature_colors
from b23d.stages.workbench.pictures.packing import as_json, data_uri
from b23d.stages.workbench.pictures.painting import marks, picture, view_picture, webp
from b23d.stages.workbench.pictures.principal import Basis
from b23d.stages.workbench.report.choosing import best_and_worst, detailed, file_keys
from b23d.stages.workbench.report.details import details
from b23d.stages.workbench.report.page import render_page
from b23d.stages.workbench.results.gathering import Gathering, ShapeResults, failures
from b23d.stages.workbench.results.matching import iou
from b23d.stages.workbench.results.rows import row
from b23d.stages.workbench.results.trust import judged

THUMB, EXAMPLE = 112, 520  # pixels; both are shown at half that
INLINE = 25  # megabytes of details that a page holds itself, unless told otherwise
Bases = dict[str, Basis | None]  # class → basis of its features
MEND = "b23d verify removes it, then b23d run makes it again"


@dataclass(frozen=True)
class Written:
    """What a report came to."""

    page: Path
    page_bytes: int
    folder: Path | None
    """Where the details lie, if they are not in the page."""
    folder_bytes: int
    shapes: int
    detailed: int


def write_report(
    run: Run,
    out: Path | None = None,
    inline: bool | None = None,
    limit: int = 500,
    draw: int | None = None,
    watch: Callable[[int, int], None] = lambda done, total: None,
) -> Written:
    """Write `runs/<name>/report.html`, or `out`, with 3D views of at most `limit` shapes.

    inline: details inside the page; None: if they take less than 25 MB. Else they lie in `<page>-details/`, one file a
    shape. draw: whose predictions are shown first; None: the first there is.
    Raises ValueError where the run has made nothing yet, OSError where it cannot write.
    """
    out = out or run.folder / "report.html"
    gathered = Gathering(run)
    rows = [_row(gathered, shape) for shape in run.shapes]
    if not any(line["points"] for line in rows):
        raise ValueError(f"run {run.name}: expected shapes to report on, got none made yet; run it first")
    bases = {category: class_basis(gathered, category) for category in {shape.category for shape in run.shapes}}
    keys, chosen = file_keys(run.shapes), detailed(rows, limit)
    out.parent.mkdir(parents=True, exist_ok=True)
    spool = out.with_name(f".{out.stem}-details.{os.getpid()}")
    spool.mkdir()

    def make(place: int) -> dict[str, Any]:
        shape, basis = run.shapes[place], bases[run.shapes[place].category]
        try:
            entry = gathered.entry(shape)
            thumb = _thumbnail(entry, basis)
            if place in chosen:
                script = f"b23d.arrive({as_json(keys[place])},{as_json(details(entry, basis))});\n"
                (spool / f"{keys[place]}.js").write_text(script)
            return {"thumb": thumb, "details": keys[place] if place in chosen else None}
        except B23dError as error:  # a damaged artifact costs its shape's view, not the report
            return {"thumb": None, "details": None, "errors": [f"report: {error}; {MEND}"], "state": "failed"}

    try:
        with ThreadPoolExecutor(os.cpu_count()) as pool:  # numpy and zlib let threads run side by side
            for place, found in enumerate(pool.map(make, range(len(rows)))):
                rows[place].update(found)
                watch(place + 1, len(rows))
        return _publish(gathered, rows, bases, out, spool, inline, draw)
    finally:
        shutil.rmtree(spool, ignore_errors=True)


def _publish(
    gathered: Gathering,
    rows: list[dict[str, Any]],
    bases: Bases,
    out: Path,
    spool: Path,
    inline: bool | None,
    draw: int | None,
) -> Written:
    run, folder = gathered.run, out.with_name(f"{out.stem}-details")
    files = sorted(spool.iterdir())
    size = sum(path.stat().st_size for path in files)
    inside = inline if inline is not None else size <= INLINE * 1e6
    drawn = [_example(gathered, run.shapes[place], bases, draw) for place, _ in best_and_worst(rows)]
    examples = [
        {"which": which, "mean": f"{rows[place]['auc']:.3f}", **example}
        for (place, which), example in zip(best_and_worst(rows), drawn, strict=True)
        if example is not None
    ]
    scripts = {path.stem: path.read_text() for path in files} if inside else {}
    analysed = run.folder / "analysis.html"
    analysis = os.path.relpath(analysed, out.parent) if analysed.is_file() else None
    page = render_page(
        run,
        gathered.plan,
        rows,
        _table(run),
        examples,
        failures(run, gathered.plan),
        folder.name,
        scripts,
        draw,
        analysis,
    )
    out.write_text(page, encoding="utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    if not inside:
        spool.rename(folder)
    views = sum(bool(line["details"]) for line in rows)
    return Written(out, out.stat().st_size, None if inside else folder, 0 if inside else size, len(rows), views)


def _row(gathered: Gathering, shape: Shape) -> dict[str, Any]:
    try:
        entry = gathered.entry(shape)
        return {**row(entry), "judged": judged(entry)}
    except B23dError as error:
        return row(ShapeResults(shape, [], errors=[f"report: {error}; {MEND}"]))


def _thumbnail(entry: ShapeResults, basis: Basis | None) -> str | None:
    if entry.normalized is None:
        return None
    if entry.views is not None:
        image = view_picture(entry.views, THUMB)
    else:
        image = picture(entry.normalized, feature_colors(entry.features, basis), THUMB)
    return data_uri(webp(image, 70), "image/webp")


def _example(gathered: Gathering, shape: Shape, bases: Bases, draw: int | None) -> dict[str, Any] | None:
    """The shape's picture with the keypoints of one draw; None where there is none of it."""
    try:
        entry = gathered.entry(shape)
        attempt = entry.attempt(draw) or entry.attempt()
        if entry.normalized is None or attempt is None or attempt.score is None:
            return None
        colors = feature_colors(entry.features, bases[shape.category])
        image = webp(picture(entry.normalized, colors, EXAMPLE, marks(entry, attempt.prediction)))
        auc = f"{iou(attempt.score).mean():.3f}"
    except B23dError:
        return None
    return {
        "name": shape.name,
        "id": shape.id,
        "category": shape.category,
        "draw": attempt.draw,
        "auc": auc,
        "image": data_uri(image, "image/webp"),
    }


def _table(run: Run) -> ScoreTable | None:
    from b23d.stages.workbench.results.scores import run_scores

    try:
        return run_scores(run) if "score" in run.config.stages else None
    except ValueError:
        return None
