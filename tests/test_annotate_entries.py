"""The annotation file keeps all that is not edited, whoever else saves."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from b23d.stages.workbench.annotate.entries import ConflictError, Edited, StaleError, edited_entry, save_entry, tag

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
