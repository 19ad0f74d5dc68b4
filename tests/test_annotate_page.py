"""The annotation page in a real browser (Debian's chromium, headless): click, undo, rename, save; the file is right."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.run import Run
from b23d.stages.workbench.annotate.server import AnnotationServer
from b23d.stages.workbench.annotate.session import Session
from tests.small_runs import make_boxes

PATIENCE = 60_000  # ms: a software renderer on a busy machine


class Annotating:
    """A page served for one shape, and everything that went wrong on it."""

    def __init__(self, browser: Any, run: Path, name: str, scheme: str = "light") -> None:
        loaded = Run.load(run)
        self.session = Session(loaded.config.dataset, loaded.shapes, name)
        self.server = AnnotationServer(self.session)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.page = browser.new_context(viewport={"width": 1366, "height": 768}, color_scheme=scheme).new_page()
        self.page.set_default_timeout(PATIENCE)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(f"{error} {error.stack[:1500]}"))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(self.server.url)
        self.page.wait_for_function("() => b23d.ready")

    def click(self, unit: list[float], **options: Any) -> None:
        """Click where this place of the shape (unit frame) is seen."""
        x, y = self.page.evaluate("unit => b23d.target.seenAt(unit)", unit)
        self.page.mouse.move(x, y)
        for key in options.get("modifiers", []):
            self.page.keyboard.down(key)
        self.page.mouse.click(x, y)
        for key in options.get("modifiers", []):
            self.page.keyboard.up(key)

    def says(self, text: str) -> None:
        self.page.wait_for_function("text => document.getElementById('status').textContent.includes(text)", arg=text)

    def keypoints(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.page.evaluate("b23d.target.keypoints")
        return found

    def close(self) -> None:
        self.page.context.close()
        self.server.shutdown()
        self.server.server_close()
        assert not self.errors
        assert all(url.startswith((self.server.url, "blob:", "data:")) for url in self.requests), (
            "nothing from the network"
        )


@pytest.fixture
def boxes(tmp_path: Path) -> Path:
    """Three boxes, the first two annotated; b2 is 1 × 0.7 × 0.8."""
    path = make_boxes(tmp_path, 3)
    file = tmp_path / "shapes" / "keypoints.json"
    file.write_text(json.dumps(json.loads(file.read_text())[:2]))
    return path


def test_a_first_shape_is_annotated_and_saved(browser: Any, boxes: Path) -> None:
    file = boxes.parent / "shapes" / "keypoints.json"
    file.unlink()
    at = Annotating(browser, boxes, "box/b2")
    assert at.page.locator("#reference-side").is_hidden() and at.page.locator("#save").is_disabled()
    front = [0.2, 0.1, 0.4]
    at.click(front)
    at.says("placed 0")
    (keypoint,) = at.keypoints()
    assert keypoint["id"] == 0 and keypoint["unit"][2] == pytest.approx(0.4, abs=1e-6)
    np.testing.assert_allclose(keypoint["unit"], front, atol=5e-3)  # a pixel
    at.page.keyboard.press("Control+z")
    at.says("undo")
    assert at.keypoints() == []
    at.click([-0.3, 0.35, 0.2])
    at.says("placed 0")
    at.click([0.5, 0.2, 0.3])
    at.says("placed 1")
    at.page.locator("#keypoints input").first.fill("7")
    at.page.locator("#keypoints input").first.press("Enter")
    at.says("0 is now 7")
    at.click([-0.2, 0.35, -0.1])
    at.says("placed 8")
    at.page.mouse.click(5, 300)  # leave the field
    at.page.locator("#save").click()
    at.says("saved 3 keypoints")
    (entry,) = json.loads(file.read_text())
    assert (entry["model_id"], entry["class_id"]) == ("b2", "box")
    assert {k["semantic_id"] for k in entry["keypoints"]} == {7, 1, 8}
    for k in entry["keypoints"]:
        corners = at.session.pickable.vertices[at.session.pickable.faces[k["mesh_info"]["face_index"]]]
        np.testing.assert_array_equal(np.asarray(k["mesh_info"]["face_uv"]) @ corners, k["xyz"])
    assert at.page.locator("#save").is_disabled()
    at.close()


def test_turning_the_view_keeps_clicks_exact(browser: Any, boxes: Path) -> None:
    at = Annotating(browser, boxes, "box/b2")
    box = at.page.locator("#target").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    at.page.mouse.move(x, y)
    at.page.mouse.down()
    at.page.mouse.move(x + 40, y + 70, steps=4)
    at.page.mouse.up()
    at.page.mouse.wheel(0, -120)
    assert at.keypoints() == [], "a drag places nothing"
    at.page.wait_for_timeout(800)  # plotly's own easing
    at.click([0.1, 0.35, 0.1])
    at.says("placed 0")
    np.testing.assert_allclose(at.keypoints()[0]["unit"], [0.1, 0.35, 0.1], atol=5e-3)
    seen = at.page.evaluate("""() => {   // plotly's own matrices agree with ours
        const plot = b23d.target.place._fullLayout.scene._scene, m = plot.glplot.cameraParams, scale = plot.dataScale;
        const times = (a, v) => [0, 1, 2, 3].map((i) => [0, 1, 2, 3].reduce((sum, j) => sum + a[4 * j + i] * v[j], 0));
        const at = [...[0.1, -0.1, 0.35].map((x, i) => x * scale[i]), 1];
        const p = [m.model, m.view, m.projection].reduce((v, a) => times(a, v), at);
        const box = b23d.target.place.getBoundingClientRect();
        return [box.left + (1 + p[0] / p[3]) / 2 * box.width, box.top + (1 - p[1] / p[3]) / 2 * box.height];
    }""")
    np.testing.assert_allclose(seen, at.page.evaluate("b23d.target.seenAt([0.1, 0.35, 0.1])"), atol=1.0)
    at.close()


def test_the_reference_gives_ids_and_others_work_is_merged(browser: Any, boxes: Path) -> None:
    file = boxes.parent / "shapes" / "keypoints.json"
    at = Annotating(browser, boxes, "box/b2", "dark")
    assert at.page.locator("#known button").all_inner_texts() == [str(i) for i in range(8)]
    assert at.page.locator("#references option").count() == 2
    at.page.keyboard.press("]")
    assert (
        at.page.locator("#next").input_value() == "1"
        and "drawn large: id 1" in at.page.locator("#reference-hint").inner_text()
    )
    at.click([0.45, 0.3, 0.4])
    at.says("placed 1")
    assert at.page.locator("#next").input_value() == "2"
    at.click([0.45, 0.3, 0.4])  # on the keypoint: selects
    at.page.wait_for_selector("tr.selected")
    at.click([0.3, 0.2, 0.4], modifiers=["Shift"])
    at.says("moved 1")
    entries = json.loads(file.read_text())
    file.write_text(json.dumps([{**entries[0], "note": "by another"}, entries[1]]))
    at.page.keyboard.press("Control+s")
    at.says("saved 1 keypoint")
    saved = json.loads(file.read_text())
    assert saved[0]["note"] == "by another" and [k["semantic_id"] for k in saved[2]["keypoints"]] == [1]
    at.page.keyboard.press("Delete")
    at.says("deleted 1")
    at.page.on("dialog", lambda dialog: dialog.dismiss())
    at.page.keyboard.press("Control+s")
    at.says("not saved: no keypoint is left")
    assert json.loads(file.read_text()) == saved
    at.page.keyboard.press("u")
    at.says("undo")
    at.errors = [line for line in at.errors if "409" not in line]  # the browser notes the server's question
    at.close()
