"""Annotating by hand: rays land exactly on the surface, the file keeps all that is not edited, a run uses what was
saved."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.dataset import Leaf, Shape
from b23d.pipeline.run import Run
from b23d.schemas.runfile import Shots
from b23d.schemas.shape import Source
from b23d.stages.datasets.annotations import load_keypoints
from b23d.stages.workbench.annotate.entries import ConflictError, Edited, StaleError, edited_entry, save_entry, tag
from b23d.stages.workbench.annotate.geometry import Pickable
from b23d.stages.workbench.annotate.needed import next_needed
from b23d.stages.workbench.annotate.server import AnnotationServer
from b23d.stages.workbench.annotate.session import Session
from tests.small_runs import make_boxes

plug_in()


def xyz(points: np.ndarray) -> bytes:
    return "\n".join(" ".join(map(repr, row)) for row in points.tolist()).encode()


def pickable(mesh: trimesh.Trimesh, cloud: np.ndarray | None = None, suffix: str = "ply") -> Pickable:
    files = {f"mesh.{suffix}": mesh.export(file_type=suffix)}
    if cloud is not None:
        files["cloud.xyz"] = xyz(cloud)
    files = {name: data.encode() if isinstance(data, str) else data for name, data in files.items()}
    return Pickable.load(
        Source(shape="box/one", files=files, mesh=f"mesh.{suffix}", cloud="cloud.xyz" if cloud is not None else None)
    )


def session(run: Run, name: str, keypoints: Path | None = None) -> Session:
    return Session(run.config.dataset, run.shapes, name, keypoints)


def click(at: Session) -> dict[str, Any]:
    """A click from above."""
    found = at.hit([0.1, 3, 0.07], [0, -1, 0])
    assert found is not None
    return found


def as_json(at: Session) -> list[dict[str, Any]]:
    """The shape's keypoints as a page sends them back unchanged."""
    return [{"id": k["id"], "was": k["id"], "hit": None} for k in at.page()["keypoints"]]


def test_a_ray_lands_on_the_first_face_it_meets() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=7.0)
    mesh.apply_translation((100, -20, 3))
    shape = pickable(mesh)
    file_vertices = shape.vertices
    for direction in np.random.default_rng(0).normal(size=(30, 3)):
        direction /= np.linalg.norm(direction)
        hit = shape.hit((-3 * direction).tolist(), direction.tolist())
        assert hit is not None and hit.mesh_info is not None and hit.pcd_info is None
        corners = file_vertices[np.asarray(mesh.faces)[hit.mesh_info["face_index"]]]
        np.testing.assert_array_equal(np.asarray(hit.mesh_info["face_uv"]) @ corners, hit.xyz)
        assert sum(hit.mesh_info["face_uv"]) == pytest.approx(1) and min(hit.mesh_info["face_uv"]) >= 0
        assert np.linalg.norm(np.cross(hit.unit, direction)) < 1e-9, "on the ray"
        assert np.dot(hit.unit, direction) < 0 and np.dot(hit.normal, direction) < 0, (
            "on the near side, seen from the viewer"
        )
    assert shape.hit([0, 3, 0], [0, 1, 0]) is None and shape.hit([0.6, 3, 0], [0, -1, 0]) is None


def test_faces_are_counted_as_the_file_has_them() -> None:
    box = trimesh.creation.box(extents=(1, 1, 1))
    faces = np.insert(
        np.asarray(box.faces), [0, 0, 5], [[0, 0, 1], [2, 2, 2], [1, 1, 3]], axis=0
    )  # degenerate ones, which cleaning drops
    shape = pickable(trimesh.Trimesh(np.asarray(box.vertices), faces, process=False))
    hit = shape.hit([0.2, 3, 0.1], [0, -1, 0])
    assert hit is not None and hit.mesh_info is not None
    corners = np.asarray(box.vertices)[faces[hit.mesh_info["face_index"]]]
    np.testing.assert_allclose(np.asarray(hit.mesh_info["face_uv"]) @ corners, [0.2, 0.5, 0.1], atol=1e-7)


def test_a_cloud_gives_one_of_its_points_and_a_mesh_names_the_nearest() -> None:
    box = trimesh.creation.box(extents=(2, 1, 1))
    points = np.asarray(trimesh.sample.sample_surface(box, 3000, seed=0)[0])
    beside = pickable(box, points).hit([0.1, 3, 0.1], [0, -1, 0])
    assert beside is not None and beside.pcd_info is not None
    assert beside.pcd_info["point_index"] == np.linalg.norm(points - beside.xyz, axis=1).argmin()
    alone = Pickable.load(Source(shape="c/a", files={"cloud.xyz": xyz(points)}, cloud="cloud.xyz"))
    hit = alone.hit([0.1, 3, 0.1], [0, -1, 0])
    assert hit is not None and hit.pcd_info is not None and hit.mesh_info is None
    np.testing.assert_array_equal(points[hit.pcd_info["point_index"]], hit.xyz)
    assert hit.xyz[1] == pytest.approx(0.5), "the near side, not what shows between its points"
    assert alone.hit([0, 3, 2], [0, -1, 0]) is None


def test_colours_of_vertices_are_drawn() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.visual.vertex_colors = np.where(mesh.vertices[:, :1] > 0, [[255, 0, 0, 255]], [[0, 0, 255, 255]])
    vertices, faces, colors = pickable(mesh).drawing()
    assert colors is not None and colors.shape == vertices.shape and len(faces)
    assert (colors[vertices[:, 0] > 0.2] == [255, 0, 0]).all() and (colors[vertices[:, 0] < -0.2] == [0, 0, 255]).all()


ENTRY = {
    "model_id": "m",
    "class_id": "c",
    "note": "kept",
    "keypoints": [{"xyz": [float(i), 0, 0], "semantic_id": 10 + i, "rgb": [i, i, i], "mine": i} for i in range(4)],
    "symmetries": {
        "reflection": [{"kp_indexes": [0, 1], "x": 1}, {"kp_indexes": [2, 3]}],
        "rotation": [{"kp_indexes": [0, 2, 3]}],
    },
}


def test_an_unedited_entry_stays_as_it_is() -> None:
    assert edited_entry(ENTRY, [Edited(10 + i, 10 + i, None) for i in range(4)]) == ENTRY


def test_symmetries_follow_their_keypoints() -> None:
    moved = {"xyz": [5, 5, 5], "pcd_info": {"point_index": 3}}
    entry = edited_entry(ENTRY, [Edited(11, 11, None), Edited(99, 12, moved), Edited(13, 13, None)])
    assert entry["symmetries"] == {"reflection": [{"kp_indexes": [1, 2]}], "rotation": [{"kp_indexes": [1, 2]}]}
    assert entry["keypoints"][1] == {"xyz": [5, 5, 5], "semantic_id": 99, "mine": 2, "pcd_info": {"point_index": 3}}
    assert entry["keypoints"][0] == ENTRY["keypoints"][1] and entry["note"] == "kept"  # type: ignore[index]
    with pytest.raises(ValueError, match="every semantic_id once"):
        edited_entry(ENTRY, [Edited(1, 10, None), Edited(1, 11, None)])


def is_m(entry: dict[str, Any]) -> bool:
    return bool(entry["model_id"] == "m")


def kept(*ids: int) -> Any:
    return lambda entry: edited_entry(entry or ENTRY, [Edited(i, i, None) for i in ids])


def test_saving_replaces_one_entry_and_keeps_what_others_did(tmp_path: Path) -> None:
    path = tmp_path / "keypoints.json"
    path.write_text(json.dumps([{**ENTRY, "model_id": "a", "more": [1.25, None]}, ENTRY]))
    path.chmod(0o640)
    given = tag(ENTRY)
    others = [{**ENTRY, "model_id": "a", "more": "changed by another"}, ENTRY, {**ENTRY, "model_id": "z"}]
    path.write_text(json.dumps(others))
    new = save_entry(path, is_m, given, kept(10), force=False)
    assert (
        json.loads(path.read_text()) == [others[0], new, others[2]] and new is not None and len(new["keypoints"]) == 1
    )
    assert path.stat().st_mode & 0o777 == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["keypoints.json"], "nothing left aside"


def test_the_same_model_changed_by_another_is_never_overwritten_silently(tmp_path: Path) -> None:
    path = tmp_path / "keypoints.json"
    path.write_text(before := json.dumps([{**ENTRY, "keypoints": ENTRY["keypoints"][1:]}]))  # type: ignore[index]
    with pytest.raises(StaleError, match="not the one this page was given"):
        save_entry(path, is_m, tag(ENTRY), kept(11), force=False)
    assert path.read_text() == before
    with pytest.raises(ValueError, match="expected keypoint 10, got none such; reload"):
        save_entry(path, is_m, tag(ENTRY), kept(10), force=True)
    assert path.read_text() == before, "keypoints are known by their ids: another's is never moved in its place"
    new = save_entry(path, is_m, tag(ENTRY), kept(12), force=True)
    assert new is not None and [k["mine"] for k in new["keypoints"]] == [2]


def test_deleting_every_keypoint_asks_and_removes_the_entry(tmp_path: Path) -> None:
    path = tmp_path / "keypoints.json"
    path.write_text(json.dumps([ENTRY, {**ENTRY, "model_id": "a"}]))
    with pytest.raises(ConflictError, match="no keypoint is left"):
        save_entry(path, is_m, tag(ENTRY), kept(), force=False)
    assert save_entry(path, is_m, tag(ENTRY), kept(), force=True) is None
    assert [e["model_id"] for e in json.loads(path.read_text())] == ["a"]


SAVER = """
import sys
from pathlib import Path
from b23d.stages.workbench.annotate.entries import save_entry, tag
path, name, times = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
given = tag(None)
for i in range(times):
    keypoints = [{"semantic_id": k, "xyz": [i, k, 0]} for k in range(i + 1)]
    entry = {"model_id": name, "keypoints": keypoints}
    given = tag(save_entry(path, lambda e: e["model_id"] == name, given, lambda _: entry, False))
"""


def test_processes_on_one_file_lose_no_save(tmp_path: Path) -> None:
    """Four processes, each saving its own model thirty times over: 120 saves in a race."""
    path, names = tmp_path / "keypoints.json", [f"m{i}" for i in range(4)]
    savers = [subprocess.Popen([sys.executable, "-c", SAVER, str(path), name, "30"]) for name in names]
    assert [saver.wait(timeout=120) for saver in savers] == [0] * 4, "nobody saw its own entry change"
    assert {e["model_id"]: len(e["keypoints"]) for e in json.loads(path.read_text())} == dict.fromkeys(names, 30)


def test_of_two_that_save_the_same_model_at_once_one_is_told(tmp_path: Path) -> None:
    path = tmp_path / "keypoints.json"
    for _ in range(40):
        path.write_text(json.dumps([ENTRY]))
        told: list[str] = []
        start = threading.Barrier(2)

        def save(id: int, told: list[str] = told, start: threading.Barrier = start) -> None:
            start.wait()
            try:
                save_entry(path, is_m, tag(ENTRY), kept(id), force=False)
                told.append("saved")
            except StaleError:
                told.append("stale")

        threads = [threading.Thread(target=save, args=(id,)) for id in (10, 11)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(told) == ["saved", "stale"]


def test_a_new_annotation_is_used_by_the_next_plan(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 4)
    file = tmp_path / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    file.write_text(json.dumps(entries[:3]))
    before = Run.load(path).plan()
    assert not any(node.stage == "score" and node.shape == "box/b3" for node in before.nodes.values())
    at = session(Run.load(path), "box/b3")
    page = at.page()
    assert [line["id"] for line in page["ids"]] == list(range(8)) and page["peers"] == 3 and page["keypoints"] == []
    assert len(at.reference("box/b1")["keypoints"]) == 8
    at.save([{"id": 4, "was": None, "hit": click(at)}], page["given"])
    saved = json.loads(file.read_text())
    assert saved[:3] == entries[:3] and saved[3]["class_id"] == "box" and saved[3]["keypoints"][0]["semantic_id"] == 4
    after = Run.load(path)
    keypoints = next(s for s in after.shapes if s.name == "box/b3").leaves["keypoints"]
    assert keypoints.values["keypoints"][0]["xyz"] == saved[3]["keypoints"][0]["xyz"]
    assert after.plan().nodes.keys() != before.nodes.keys(), "the shots or the scores have new addresses"


def test_saving_twice_and_moving(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 2)
    at = session(Run.load(path), "box/b0")
    keypoints = as_json(at)
    moved = click(at)
    keypoints[2]["hit"] = moved
    given = at.save(keypoints, at.page()["given"])["given"]
    at.save(as_json(at)[:-1], given)
    entry = json.loads((tmp_path / "shapes" / "keypoints.json").read_text())[0]
    assert len(entry["keypoints"]) == 7 and entry["keypoints"][2]["xyz"] == moved["xyz"] and entry["model_id"] == "b0"


def test_published_and_exact_annotations_are_refused(tmp_path: Path) -> None:
    run = tmp_path / "p.toml"
    run.write_text('name = "p"\n[dataset]\nkind = "procedural"\nclasses = ["mug"]\ncount = 4\n')
    loaded = Run.load(run)
    name = loaded.shapes[0].name
    with pytest.raises(ValueError, match=r"exact by construction.*--keypoints FILE"):
        session(loaded, name)
    at = session(loaded, name, tmp_path / "mine.json")
    kept = as_json(at)
    assert kept, "starts from what the data set knows"
    at.save(kept, at.page()["given"])
    assert len(json.loads((tmp_path / "mine.json").read_text())[0]["keypoints"]) == len(kept)
    result = CliRunner().invoke(app, ["annotate", str(run), name, "--no-browser"])
    assert isinstance(result.exception, ValueError) and "procedural" in str(result.exception)


def test_unknown_shapes_get_a_hint(tmp_path: Path) -> None:
    run = Run.load(make_boxes(tmp_path, 2))
    with pytest.raises(KeyError, match="did you mean 'box/b1'"):
        session(run, "b1")


@pytest.fixture
def server(tmp_path: Path) -> Iterator[AnnotationServer]:
    with AnnotationServer(session(Run.load(make_boxes(tmp_path, 2)), "box/b0")) as server:
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
    before = server.session.path.read_text()
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
    assert saved(keypoints=[])[0] == 409
    status, text = saved(given="older")
    assert status == 409 and json.loads(text)["stale"] is True
    assert saved(keypoints={"a": 1})[0] == saved(given=3)[0] == saved(force="perhaps")[0] == saved(new=1)[0] == 400
    assert ask(f"{server.url}hit", {"origin": [0, 3, 0], "direction": [0, 1, 0]}) == (200, b"null")
    rays: list[Any] = [{"origin": at, "direction": [0, 1, 0]} for at in ([0, 3], [float("nan"), 3, 0], None)]
    for ray in ({}, [], {"origin": [0, 3, 0], "direction": [0, 0, 0]}, *rays):
        assert ask(f"{server.url}hit", ray)[0] == 400, ray
    assert server.session.path.read_text() == before


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
    before = server.session.path.read_text()
    assert ask(f"{server.url}save", {"keypoints": all_of_it[:-1], "given": state["given"]})[0] == 409
    assert server.session.path.read_text() == before
    again = json.loads(ask(f"{server.url}state")[1])
    assert len(again["keypoints"]) == len(all_of_it) - 1 and again["given"] != state["given"]
    whole = [{"id": k["id"], "was": k["id"], "hit": k["at"]} for k in state["keypoints"]]
    assert ask(f"{server.url}save", {"keypoints": whole, "given": state["given"], "force": True})[0] == 200


def test_the_next_shape_is_the_one_a_run_needs() -> None:
    leaf = Leaf(load_keypoints)
    made = [Shape("a", "box", {"keypoints": leaf}), Shape("b", "box", {}), Shape("c", "box", {}), Shape("d", "cup", {})]
    assert next_needed(made, Shots(count=2)) == ("box/b", "box: 1 annotated, 1 more of 2 shots wanted")
    assert next_needed(made, Shots(count=1))[0] == "cup/d", "the class that wants shots goes first"
    assert next_needed(made, Shots(ids={"box": ["c"]}))[0] == "box/c"
    assert next_needed(made[:2], Shots(count=1))[0] == "box/b", "further annotations give scores"
    with pytest.raises(ValueError, match="name one to change"):
        next_needed(made[:1], Shots())
