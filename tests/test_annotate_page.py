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
from b23d.stages.workbench.annotate.walk import Walk
from tests.small_runs import make_boxes

PATIENCE = 60_000  # ms: a software renderer on a busy machine


class Annotating:
    """A page served for one shape, and everything that went wrong on it."""

    def __init__(self, browser: Any, run: Path, name: str, scheme: str = "light") -> None:
        self.walk = Walk(Run.load(run), name)
        self.server = AnnotationServer(self.walk)
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
    at.page.locator("#keypoints input[type=number]").first.fill("7")
    at.page.locator("#keypoints input[type=number]").first.press("Enter")
    at.says("0 is now 7")
    at.click([-0.2, 0.35, -0.1])
    at.says("placed 8")
    at.page.mouse.click(5, 300)  # leave the field
    at.page.locator("#save").click()
    at.says("saved 3 keypoints")
    (entry,) = json.loads(file.read_text())
    assert (entry["model_id"], entry["class_id"]) == ("b2", "box")
    assert {k["semantic_id"] for k in entry["keypoints"]} == {7, 1, 8}
    shape = at.walk.at().pickable
    for k in entry["keypoints"]:
        corners = shape.vertices[shape.faces[k["mesh_info"]["face_index"]]]
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


def test_names_are_given_shown_and_saved(browser: Any, boxes: Path) -> None:
    file = boxes.parent / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    entries[0]["keypoints"][0]["name"] = "left foot"
    file.write_text(json.dumps(entries))
    at = Annotating(browser, boxes, "box/b2")
    at.click([-0.3, 0.1, 0.4])
    at.says("placed 0 (left foot)")
    at.click([0.3, 0.2, 0.4])
    at.says("placed 1")
    assert at.page.locator("#missing").inner_text().startswith("missing here: 2, 3, 4, 5, 6, 7.")
    at.page.get_by_label("name of keypoint 1").fill("  right hand ")
    at.page.get_by_label("name of keypoint 1").press("Enter")
    at.says("1 is called right hand")
    at.page.mouse.click(5, 300)  # leave the field
    at.page.keyboard.press("Control+s")
    at.says("saved 2 keypoints")
    saved = json.loads(file.read_text())[2]["keypoints"]
    assert [(k["semantic_id"], k["name"]) for k in saved] == [(0, "left foot"), (1, "right hand")]
    for place, keypoint in zip(at.page.locator("#keypoints .place").all_inner_texts(), saved, strict=True):
        assert [float(x) for x in place.split()] == keypoint["xyz"], "coordinates as saved, every digit"
    x, y = at.page.evaluate("unit => b23d.target.seenAt(unit)", at.keypoints()[1]["unit"])
    at.page.mouse.move(x, y)
    at.page.wait_for_function("() => !b23d.target.tip.hidden")
    assert "1 (right hand)" in at.page.evaluate("b23d.target.tip.textContent")
    at.close()


def test_a_click_beside_the_shape_takes_the_surface_and_on_request_the_tip(browser: Any, boxes: Path) -> None:
    at = Annotating(browser, boxes, "box/b2")
    right, y = at.page.evaluate("unit => b23d.target.seenAt(unit)", [0.5, 0.0, -0.4])  # the outline's right edge
    at.page.mouse.click(right + 60, y)
    at.says("the click missed the shape")
    at.page.mouse.click(right + 4, y)
    at.says("placed 0")
    (keypoint,) = at.keypoints()
    np.testing.assert_allclose(keypoint["unit"], [0.5, 0, -0.4], atol=0.01)  # on the edge that was nearly met
    at.page.keyboard.press("e")
    assert at.page.locator("#tips").get_attribute("aria-pressed") == "true"
    at.click([0.47, 0.32, 0.4])
    at.says("placed 1")
    np.testing.assert_allclose(at.keypoints()[1]["unit"], [0.5, 0.35, 0.4], atol=1e-6)
    at.page.locator("#tips").click()
    assert at.page.locator("#tips").get_attribute("aria-pressed") == "false"
    at.close()


def test_the_walk_goes_on_in_the_page(browser: Any, boxes: Path) -> None:
    file = boxes.parent / "shapes" / "keypoints.json"
    file.write_text(json.dumps(json.loads(file.read_text())[:1]))
    run = boxes.read_text()
    boxes.write_text(run.replace("count = 2", "count = 3"))
    at = Annotating(browser, boxes, "box/b1")
    assert at.page.locator("#walk").inner_text() == "box: 1 of 3 shots annotated"
    at.click([0.2, 0.1, 0.4])
    at.says("placed 0")
    with at.page.expect_navigation():
        at.page.keyboard.press("n")
    at.page.wait_for_function("() => b23d.ready")
    assert at.page.locator("#name").inner_text() == "box/b2"
    assert at.page.locator("#walk").inner_text() == "box: 2 of 3 shots annotated"
    assert [k["semantic_id"] for k in json.loads(file.read_text())[1]["keypoints"]] == [0], "saved on the way"
    assert at.page.locator("#following").is_disabled()
    with at.page.expect_navigation():
        at.page.locator("#previous").click()
    at.page.wait_for_function("() => b23d.ready")
    assert at.page.locator("#name").inner_text() == "box/b1" and len(at.keypoints()) == 1
    at.close()


@pytest.mark.parametrize("width", [420, 1366])
def test_everything_is_within_the_window(browser: Any, boxes: Path, width: int) -> None:
    at = Annotating(browser, boxes, "box/b2")
    at.page.set_viewport_size({"width": width, "height": 768})
    at.page.reload()
    at.page.wait_for_function("() => b23d.ready")
    assert at.page.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("#save", "#following", "#target", "#reference", "#known", "#tips"):
        box = at.page.locator(name).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width, name
    inside = at.page.evaluate("""() => ["target", "referenceView"].map((name) => {
        const view = b23d[name], box = view.place.getBoundingClientRect(), { x, y, z } = view.surface;
        return x.every((_, i) => {
            const [across, down] = view.seenAt([x[i], z[i], -y[i]]);
            return across >= box.left && across <= box.right && down >= box.top && down <= box.bottom;
        });
    })""")
    assert inside == [True, True], "both shapes are whole"
    at.close()
