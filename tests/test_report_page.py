"""The report in a real browser (Debian's chromium, headless): it opens, sorts, filters, shows shapes in 3D, answers
clicks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.stages.workbench.analyses.interface import Chart, ExecutedMember, Result
from b23d.stages.workbench.analyses.page import render_page
from b23d.stages.workbench.pictures.coloring import class_basis
from b23d.stages.workbench.report.details import CHANNELS
from b23d.stages.workbench.report.writing import write_report
from b23d.stages.workbench.results.gathering import Gathering
from tests.report_runs import mixed

PAINTED = "document.getElementById('viewer-dialog').dataset.painted"  # mode, and side:point if one is clicked
PATIENCE = 60_000  # ms: a software renderer on a busy machine


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(mixed(), tmp_path_factory.mktemp("report") / "report.html", inline=False).page


class Page:
    """An opened report, and everything that went wrong on it."""

    def __init__(self, browser: Any, path: Path, scheme: str = "light") -> None:
        self.page = browser.new_context(viewport={"width": 1280, "height": 800}, color_scheme=scheme).new_page()
        self.page.set_default_timeout(PATIENCE)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())

    def names(self) -> list[str]:
        return [text.strip() for text in self.page.locator("#shape-table tbody b").all_inner_texts()]

    def painted(self, start: str) -> None:
        """Wait until the view shows this mode (and clicked point)."""
        self.page.wait_for_function(f"start => ({PAINTED} ?? '').startsWith(start)", arg=start)

    def open(self, name: str) -> None:
        self.page.locator("#shape-table tbody tr", has_text=name).click()
        self.painted("pca")

    def mode(self, name: str) -> None:
        self.page.click(f".modes label:has(input[value={name}])")

    def click_point(self, side: int, point: int) -> None:
        """As plotly tells which candidate is under the pointer, and the browser that it is clicked."""
        self.page.evaluate(
            """([side, point]) => {
                const place = document.getElementById(`viewer-scene-${side}`);
                place.emit("plotly_hover", { points: [{ curveNumber: 1, pointNumber: point }] });
                const where = { clientX: 9, clientY: 9 };
                for (const name of ["pointerdown", "pointerup"]) place.dispatchEvent(new PointerEvent(name, where));
            }""",
            [side, point],
        )

    def colors(self, side: int = 0) -> list[str]:
        """What candidates are coloured."""
        found: list[str] = self.page.evaluate(f"document.getElementById('viewer-scene-{side}').data[1].marker.color")
        return found


@pytest.fixture
def page(browser: Any, report: Path) -> Iterator[Page]:
    opened = Page(browser, report)
    yield opened
    assert opened.errors == [], "nothing on the console"
    folder = report.parent.as_uri()
    assert all(url.startswith((folder, "data:", "blob:")) for url in opened.requests), "nothing from the network"
    opened.page.context.close()


def test_it_opens_with_scores_failures_and_all_shapes(page: Page) -> None:
    page.page.wait_for_selector("#curves .legend")
    assert page.page.locator("#scores tbody tr").count() == 5, "two classes, their mean, two quoted from the paper"
    assert "box/broken" in page.page.locator("#failures").inner_text()
    assert page.page.locator("#examples .example").count() == 4
    assert "stages.learn.ridge" in page.page.locator("#settings").inner_text()
    assert page.names() == ["b0", "b1", "b2", "b3", "broken", "e0", "e1", "e2", "l0"]
    assert page.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "fits a laptop's width"


def test_the_table_sorts_and_filters(page: Page) -> None:
    page.page.click("#shape-table th button[data-key=auc]")
    values = [float(text) for text in page.page.locator("#shape-table td:nth-child(2):not(:empty)").all_inner_texts()]
    assert values == sorted(values, reverse=True) and len(values) > 3
    assert page.page.locator("#shape-table th[aria-sort=descending]").inner_text().startswith("AUC")
    unscored = set(page.page.evaluate("b23d.data.rows.filter(row => row.auc === null).map(row => row.id)"))
    assert {"broken", "l0"} <= unscored and set(page.names()[-len(unscored) :]) == unscored, (
        "what has no score comes last"
    )
    page.page.click("#shape-table th button[data-key=auc]")
    assert set(page.names()[-len(unscored) :]) == unscored
    page.page.select_option("#filter-class", "egg")
    assert (
        sorted(page.names()) == ["e0", "e1", "e2"] and page.page.locator("#shape-count").inner_text() == "3 of 9 shapes"
    )
    page.page.select_option("#filter-class", "")
    page.page.fill("#filter-text", "expected")
    assert page.names() == ["broken"], "errors are searched, too"


def test_a_row_opens_the_view_and_modes_change_the_colours(page: Page) -> None:
    page.open("e0")
    assert page.page.locator("#viewer-title").inner_text() == "e0"
    seen = {"pca": page.colors()}
    for mode in ("plain", "views"):
        page.mode(mode)
        page.painted(mode)
        seen[mode] = page.colors()
    assert len({json.dumps(colors) for colors in seen.values()}) == 3 and {len(colors) for colors in seen.values()} == {
        642
    }
    assert page.page.locator("#viewer-keypoints tr").count() == 6
    assert "views that see the point" in page.page.locator("#viewer-legend").inner_text()
    page.page.uncheck("[data-option=truth]")
    page.page.wait_for_function("document.getElementById('viewer-scene-0').data[3].x.length === 0")
    page.page.keyboard.press("Escape")
    page.page.wait_for_function("!document.getElementById('viewer-dialog').open")


def test_a_clicked_point_shows_the_distances_that_are_stored(page: Page) -> None:
    page.open("e0")
    page.mode("geodesic")
    page.painted("geodesic")
    page.click_point(0, 17)
    page.painted("geodesic 0:17")
    shown = page.page.evaluate("b23d.load('egg-e0').then(shape => Array.from(shape.distances.row(17)))")
    indices = page.page.evaluate("b23d.load('egg-e0').then(shape => Array.from(shape.indices))")
    stored = mixed().artifact("egg/e0", "geodesic")
    assert isinstance(stored, GeodesicDistances)
    row = stored.distances[indices[17], indices].astype(float)
    spacing = float(np.sort(stored.distances.astype(float), axis=1)[:, 6].max())  # all landmarks of a point lie so near
    assert np.abs(np.array(shown) - row).max() <= 2 * spacing + float(stored.distances.max()) / 255
    assert shown[17] == 0
    before = page.colors()
    page.click_point(0, 90)
    page.painted("geodesic 0:90")
    assert page.colors() != before


def test_similarity_reaches_across_to_another_shape(page: Page) -> None:
    page.open("e0")
    page.page.select_option("#viewer-other", "egg/e2")
    page.page.wait_for_function("document.getElementById('viewer-scene-1').data?.length === 7")
    page.click_point(0, 40)
    page.painted("similarity 0:40")
    found = np.array(
        page.page.evaluate(
            """async () => {
                const vector = b23d.fields.vectorOf(await b23d.load("egg-e0"), 40);
                const other = await b23d.load("egg-e2"), { indices } = await b23d.load("egg-e0");
                return [indices[40], ...other.indices, ...b23d.fields.similarity(other, vector).values];
            }"""
        )
    )
    run = mixed()
    basis = class_basis(Gathering(run), "egg")
    first, second = run.artifact("egg/e0", "reweight"), run.artifact("egg/e2", "reweight")
    assert basis is not None and isinstance(first, PointFeatures) and isinstance(second, PointFeatures)
    count = len(second.features)
    clicked, indices, shown = int(found[0]), found[1 : 1 + count].astype(int), found[1 + count :]
    a = basis.project(first.features[[clicked]])[0, :CHANNELS]
    b = basis.project(second.features[indices])[:, :CHANNELS]
    np.testing.assert_allclose(shown, b @ a / np.linalg.norm(a) / np.linalg.norm(b, axis=1), atol=0.02)
    here, there = page.colors(0), page.colors(1)
    page.click_point(1, 7)
    page.painted("similarity 1:7")
    assert page.colors(0) != here and page.colors(1) != there, "the other shape's points can be clicked as well"


def test_a_real_click_picks_what_is_under_the_pointer_and_a_turn_does_not(page: Page) -> None:
    page.open("b1")
    box = page.page.locator("#viewer-scene-0").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def hover() -> None:
        """Move a little until the drawn surface is found under the pointer: a while without a GPU."""
        for step in range(100):
            page.page.mouse.move(x + step % 5, y)
            page.page.wait_for_timeout(100)
            if page.page.evaluate("document.getElementById('viewer-scene-0').dataset.under") == "surface":
                return
        pytest.fail("expected the box under the pointer, got nothing")

    hover()
    page.page.mouse.down()
    page.page.mouse.move(x + 60, y + 10, steps=4)
    page.page.mouse.up()
    page.page.wait_for_timeout(300)
    assert page.page.evaluate(PAINTED) == "pca", "turning is not clicking"
    hover()
    page.page.mouse.down()
    page.page.mouse.up()
    page.painted("similarity 0:")


def test_missing_details_are_told_and_a_link_opens_a_shape(browser: Any, report: Path, tmp_path: Path) -> None:
    alone = Path(shutil.copy(report, tmp_path / "report.html"))
    opened = Page(browser, alone)
    opened.page.evaluate("location.hash = encodeURIComponent('box/b1')")
    opened.page.wait_for_function(
        "document.getElementById('viewer-message').textContent.includes('not beside this page')"
    )
    opened.page.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_follows_the_systems_colours_until_told_otherwise(browser: Any, report: Path, scheme: str) -> None:
    opened = Page(browser, report, scheme)
    theme, other = "document.documentElement.dataset.theme", {"light": "dark", "dark": "light"}[scheme]
    assert opened.page.evaluate(theme) == scheme
    opened.page.click("#theme")
    assert opened.page.evaluate(theme) == other and opened.errors == []
    opened.page.context.close()


def test_inline_details_need_no_folder(browser: Any, tmp_path: Path) -> None:
    opened = Page(browser, write_report(mixed(), tmp_path / "whole.html", inline=True).page)
    opened.open("e1")
    assert opened.errors == [] and not any(url.endswith(".js") for url in opened.requests)
    opened.page.context.close()


def test_it_fits_a_telephone(browser: Any, report: Path) -> None:
    opened = Page(browser, report)
    opened.page.wait_for_selector(".main-svg")
    opened.page.set_viewport_size({"width": 420, "height": 800})
    opened.page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")  # charts follow a little later
    opened.open("e0")
    scene, controls = (opened.page.locator(name).bounding_box() for name in ("#viewer-scene-0", "#viewer-controls"))
    assert scene["width"] == controls["width"] == 420 and controls["y"] >= scene["y"] + scene["height"]
    opened.page.context.close()


def test_an_analysis_is_drawn_in_the_readers_colours(browser: Any, tmp_path: Path) -> None:
    table = pd.DataFrame({"descriptor": ["one"], "AUC": [0.5]})
    chart = Chart(go.Figure(go.Scatter(x=[0, 1], y=[0, 1])), "a line")
    member = ExecutedMember("one", "", mixed())
    path = tmp_path / "analysis.html"
    path.write_text(render_page("mixed", "run.toml", [member], Result("Title", table, "note", [chart]), ""))
    opened = Page(browser, path, "dark")
    opened.page.wait_for_selector("#figure-0 .main-svg")
    ink = "getComputedStyle(document.querySelector('#figure-0 .xtick text')).fill"
    dark = opened.page.evaluate(ink)
    opened.page.click("#theme")
    opened.page.wait_for_function(f"dark => {ink} !== dark", arg=dark)
    assert opened.errors == []
    opened.page.context.close()
