"""What the page's server answers: to strangers, to malformed requests, to stale tabs."""

from __future__ import annotations

import json
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from b23d.pipeline.cli import plug_in
from b23d.pipeline.run import Run
from b23d.stages.workbench.annotate.server import AnnotationServer
from b23d.stages.workbench.annotate.walk import Walk
from tests.small_runs import make_boxes

plug_in()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[AnnotationServer]:
    with AnnotationServer(Walk(Run.load(make_boxes(tmp_path, 2)), "box/b0")) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(url: str, body: Any = None, **headers: str) -> tuple[int, bytes]:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json", **headers})
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_only_who_has_the_whole_address_is_served(server: AnnotationServer) -> None:
    base = server.url.removesuffix(f"{server.token}/")
    assert server.server_address[0] == "127.0.0.1"
    assert ask(base)[0] == ask(f"{base}wrong/state")[0] == ask(f"{base}wrong/save", {"keypoints": []})[0] == 403
    assert ask(f"{server.url}state", Host="evil.example:80")[0] == 403, "another name pointed at this machine"
    assert ask(f"{server.url}../pyproject.toml")[0] in (403, 404)
    for name in ("", "annotate.js", "view.js", "balls.js", "theme.js", "annotate.css", "state", "reference/box%2Fb1"):
        assert ask(server.url + name)[0] == 200, name


def test_the_server_tells_what_is_wrong(server: AnnotationServer) -> None:
    before = server.walk.at().path.read_text()
    given = json.loads(ask(f"{server.url}state")[1])["given"]
    unmoved = {"id": 0, "was": 0, "hit": None}

    def saved(**body: Any) -> tuple[int, bytes]:
        return ask(f"{server.url}save", {"keypoints": [unmoved], "given": given, **body})

    for keypoint in (
        {**unmoved, "was": 99}, {**unmoved, "was": -1}, {**unmoved, "id": -1}, {**unmoved, "id": 1.5},
        {**unmoved, "id": True}, {**unmoved, "id": "0"}, {**unmoved, "hit": {}},
        {**unmoved, "place": 0}, {**unmoved, "hit": {"xyz": [0, 0]}},
        {**unmoved, "hit": {"xyz": [0, 0, float("nan")]}}, {**unmoved, "hit": {"xyz": [0, 0, float("-inf")]}},
        {**unmoved, "hit": {"xyz": [0, 0, "x"]}},
        {**unmoved, "hit": {"xyz": [0, 0, 0], "pcd_info": {"point_index": -1}}},
        {"id": 0}, 3, None, [],
    ):  # fmt: skip
        status, text = saved(keypoints=[keypoint])
        assert status == 400 and json.loads(text)["error"], keypoint
    status, text = saved(keypoints=[{"id": 1, "was": 0, "hit": None}, {"id": 1, "was": 1, "hit": None}])
    assert status == 400 and b"every semantic_id once" in text
    status, text = saved(keypoints=[{"id": 0, "was": 0, "hit": None}, {"id": 1, "was": 0, "hit": None}])
    assert status == 400 and b"expected keypoint 0 once, got it twice" in text
    assert saved(keypoints=[])[0] == 409
    status, text = saved(given="older")
    assert status == 409 and json.loads(text)["stale"] is True
    assert saved(keypoints={"a": 1})[0] == saved(given=3)[0] == saved(force="perhaps")[0] == saved(new=1)[0] == 400
    assert ask(f"{server.url}hit", {"origin": [0, 3, 0], "direction": [0, 1, 0]}) == (200, b"null")
    rays: list[Any] = [{"origin": at, "direction": [0, 1, 0]} for at in ([0, 3], [float("nan"), 3, 0], None)]
    for ray in ({}, [], {"origin": [0, 3, 0], "direction": [0, 0, 0]}, *rays):
        assert ask(f"{server.url}hit", ray)[0] == 400, ray
    up = {"origin": [0, 3, 0], "direction": [0, 1, 0]}
    for field in ({"within": -1}, {"within": 1}, {"within": float("nan")}, {"extremity": "perhaps"}):
        assert ask(f"{server.url}hit", {**up, **field})[0] == 400, field
    for path, body in (("state", None), ("hit", up), ("save", {"keypoints": [unmoved], "given": given})):
        status, text = ask(f"{server.url}{path}?shape=box%2Fb7", body)
        assert status == 400 and b"expected one of the data set's" in text, path
    assert server.walk.at().path.read_text() == before


@pytest.mark.parametrize(
    ("headers", "body"),
    [
        ("Content-Type: application/json\r\nContent-Length: x", b""),
        ("Content-Type: application/json\r\nContent-Length: -5", b""),
        ("Content-Type: application/json\r\nContent-Length: 99999999999999999999999", b""),
        ("Content-Type: application/json", b""),
        ("Content-Type: text/plain\r\nContent-Length: 2", b"{}"),
        ("Content-Type: application/json\r\nContent-Length: 4", b"\xff\xfe{}"),
        ("Content-Type: application/json\r\nContent-Length: 3", b"{]}"),
        ("Content-Type: application/json\r\nContent-Length: 40000", b"[" * 40_000),
        ("Content-Type: application/json\r\nContent-Length: 4\r\nOrigin: http://evil.example", b"null"),
        ("Content-Type: application/json\r\nContent-Length: 4\r\nOrigin: null", b"null"),
    ],
)
def test_malformed_requests_are_answered(
    server: AnnotationServer, headers: str, body: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    host, port = "127.0.0.1", int(server.server_address[1])
    for path in ("save", "hit"):
        with socket.create_connection((host, port), timeout=20) as opened:
            head = (
                f"POST /{server.token}/{path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n{headers}\r\n\r\n"
            )
            opened.sendall(head.encode() + body)
            answer = b"".join(iter(lambda: opened.recv(65536), b""))
        assert answer.split(b" ")[1] in (b"400", b"403", b"413"), answer[:200]
    assert ask(f"{server.url}state")[0] == 200, "the server goes on"
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_stale_tab_moves_nothing(server: AnnotationServer) -> None:
    """One tab deletes a keypoint; another, loaded before, saves what it had."""
    state = json.loads(ask(f"{server.url}state")[1])
    all_of_it = [{"id": k["id"], "was": k["id"], "hit": None} for k in state["keypoints"]]
    assert ask(f"{server.url}save", {"keypoints": all_of_it[1:], "given": state["given"]})[0] == 200
    before = server.walk.at().path.read_text()
    assert ask(f"{server.url}save", {"keypoints": all_of_it[:-1], "given": state["given"]})[0] == 409
    assert server.walk.at().path.read_text() == before
    again = json.loads(ask(f"{server.url}state")[1])
    assert len(again["keypoints"]) == len(all_of_it) - 1 and again["given"] != state["given"]
    whole = [{"id": k["id"], "was": k["id"], "hit": k["at"]} for k in state["keypoints"]]
    assert ask(f"{server.url}save", {"keypoints": whole, "given": state["given"], "force": True})[0] == 200


def test_each_page_has_the_shape_of_its_address(server: AnnotationServer) -> None:
    """Two tabs on two shapes: each sees, hits and saves its own."""
    first, second = (json.loads(ask(f"{server.url}state{query}")[1]) for query in ("", "?shape=box%2Fb1"))
    assert (first["name"], second["name"]) == ("box/b0", "box/b1")
    down = {"origin": [0.1, 3, 0.05], "direction": [0, -1, 0]}
    heights = [json.loads(ask(f"{server.url}hit{q}", down)[1])["xyz"][1] for q in ("", "?shape=box%2Fb1")]
    assert heights == pytest.approx([0.25, 0.3])
    kept = [{"id": k["id"], "was": k["id"], "hit": None} for k in second["keypoints"][:3]]
    body = {"keypoints": kept, "given": second["given"]}
    assert ask(f"{server.url}save?shape=box%2Fb1", body)[0] == 200
    entries = json.loads(server.walk.at().path.read_text())
    assert [len(entry["keypoints"]) for entry in entries] == [8, 3]
