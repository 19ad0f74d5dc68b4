"""`b23d analyse`: what it compares has known answers; every run file in runs/analyses plans; the command writes its
page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import members
from b23d.schemas.keypoints import Keypoints
from b23d.stages.describe import DescribeParams, describe
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.workbench.analyses.comparing import centred, cosine, nearer_share, typical_difference
from b23d.stages.workbench.analyses.running import analysis_of
from b23d.stages.workbench.analyses.semantic import Described, searches
from b23d.stages.workbench.commands.analyse import analyse
from tests.shared_data import shared

FILES = sorted((Path(__file__).parents[1] / "runs" / "analyses").glob("*.toml"))
TINY = {
    "stages.normalize.count": "96", "dataset.points": "96", "stages.render.rings.count": "1",
    "stages.render.resolution": "48",
    "stages.extract.encoder": '"efficientnet-lite0"', "stages.describe.hks.eigenpairs": "24", "dataset.count": "2",
    "dataset.classes": '["mug"]',
}  # fmt: skip
rng = np.random.default_rng(0)


def tiny(name: str, folder: Path, more: dict[str, str] | None = None) -> tuple[Path, list[str]]:
    """A run file in `folder` that extends runs/analyses/<name>.toml, and overrides that make it small."""
    base = next(path for path in FILES if path.stem == name)
    (folder / f"{name}.toml").write_text(f'name = "{name}"\nbase = "{base}"\n')
    kind = load_config(base).file.dataset["kind"]
    other = {"pairs": ("dataset.count", "dataset.classes"), "procedural": ("dataset.points",)}.get(kind, ("dataset.",))
    settings = {field: value for field, value in TINY.items() if not field.startswith(other)} | (more or {})
    return folder / f"{name}.toml", [f"{field}={value}" for field, value in settings.items()]


def analysed(name: str, folder: Path, more: dict[str, str] | None = None) -> tuple[pd.DataFrame, str]:
    """The table and the page of a small run of that run file."""
    path, overrides = tiny(name, folder, more)
    analyse(path, overrides, str(folder / "store"), workers=0)
    return pd.read_csv(folder / name / "analysis.csv"), (folder / name / "analysis.html").read_text()


def test_cosine_is_one_with_itself_and_knows_no_scale() -> None:
    a, b = rng.normal(size=(2, 50, 7))
    assert np.allclose(cosine(a, 3 * a), 1) and np.allclose(cosine(a, -a), -1)
    assert np.allclose(cosine(a, b), cosine(b, a)) and (np.abs(cosine(a, b)) < 1).all()
    zeros = np.zeros((2, 7))
    assert cosine(zeros, zeros).tolist() == [1, 1] and cosine(zeros, a[:2]).tolist() == [0, 0]
    assert np.allclose(centred(a, a).mean(axis=0), 0)


def test_typical_difference_scales_and_forgets_an_offset() -> None:
    a = rng.normal(size=(400, 5))
    assert typical_difference(a) == pytest.approx(typical_difference(a + 9), rel=1e-9)
    assert typical_difference(2 * a) == pytest.approx(2 * typical_difference(a))
    assert typical_difference(np.array([[0.0], [3.0]])) == 3, "two different points"


def test_nearer_share_counts_ties_half_and_skips_nan() -> None:
    others = np.array([[1.0, 2.0, 3.0, np.nan], [5.0, 5.0, np.nan, np.nan], [np.nan] * 4])
    assert nearer_share(np.array([2.5, 5.0, 1.0]), others).tolist()[:2] == [pytest.approx(2 / 3), 0.5]
    assert np.isnan(nearer_share(np.array([2.5, 5.0, 1.0]), others)[2])


def made_up(features: np.ndarray, count: int, mirrored: bool = False) -> Described:
    """Points far apart, the first `count` of them keypoints."""
    orbits = [(0, 1)] if mirrored else []
    ids = np.arange(count, dtype=np.int32)
    keypoints = Keypoints(ids=ids, positions=np.zeros((count, 3)), point_indices=ids, reflections=orbits)
    points = np.stack([np.arange(len(features)), *np.zeros((2, len(features)))], axis=1)
    return Described(keypoints, points, features, np.arange(count))


def test_exact_descriptors_find_every_keypoint_and_random_ones_guess() -> None:
    exact = searches([made_up(np.eye(300), 6) for _ in range(3)], near=0.05)
    assert len(exact) == 6 * 6 and (exact[["points", "ids", "error"]] == 0).all(axis=None)
    random = searches([made_up(rng.normal(size=(300, 20)), 20) for _ in range(4)], near=0.05)
    assert random["points"].mean() == pytest.approx(0.5, abs=0.08) and random["ids"].mean() == pytest.approx(
        0.5, abs=0.08
    )


def test_what_a_symmetry_exchanges_is_not_wrong() -> None:
    features = np.eye(300)
    swapped = features[[1, 0, *range(2, 300)]]
    plain = searches([made_up(features, 3), made_up(swapped, 3)], near=0.05)
    assert (plain.loc[plain["id"] < 2, ["points", "ids", "error"]] > 0).all(axis=None)
    mirrored = searches([made_up(features, 3, True), made_up(swapped, 3, True)], near=0.05)
    assert (mirrored["error"] == 0).all(), "the mate is as good"
    assert (mirrored.loc[mirrored["id"] < 2, "ids"] == 0.5).all(), (
        "nothing is wrong but the third, which is as far as the right one"
    )


def test_hks_is_blind_to_the_isometry_and_shot_is_not(tmp_path: Path) -> None:
    from b23d.stages.datasets.procedural.pairs import Pairs

    both = []
    for shape in Pairs(kind="pairs", pairs=["cubes"], points=256).shapes():
        leaf = shape.leaves["source"]
        both.append(normalize(leaf.load({}, leaf.values), NormalizeParams()))
    for descriptor, alike in (("hks", True), ("wks", True), ("shot", False)):
        params = DescribeParams.model_validate(
            {"descriptor": descriptor, "hks": {"eigenpairs": 32}, "wks": {"eigenpairs": 32}}
        )
        a, b = (describe(shape, params).features.astype(np.float64) for shape in both)
        difference = np.linalg.norm(a - b, axis=1) / typical_difference(a)
        assert (difference.max() < 0.02) if alike else (difference.mean() > 0.2), descriptor


@pytest.mark.parametrize("pair", ["cubes", "boxes", "bump", "stretch", "engines"])
def test_a_pair_differs_in_one_place_only(pair: str) -> None:
    from b23d.stages.datasets.procedural.pairs import Pairs, made

    first, second = made(pair)  # type: ignore[arg-type]
    assert (first.faces == second.faces).all()
    moved = np.linalg.norm(first.vertices - second.vertices, axis=1)
    assert 0.01 < (moved > 0).mean() < 0.35 and moved.max() > 0.03
    shapes = []
    for shape in Pairs(kind="pairs", pairs=[pair], points=128).shapes():  # type: ignore[list-item]
        leaf = shape.leaves["source"]
        shapes.append(normalize(leaf.load({}, leaf.values), NormalizeParams()))
    gaps = np.linalg.norm(np.subtract(*[shape.to_source(shape.points.astype(np.float64)) for shape in shapes]), axis=1)
    assert (gaps < 1e-5).mean() > 0.6, "points correspond"
    assert pair == "cubes" or np.ptp([shape.scale for shape in shapes]) < 1e-6, "and live in one scale"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_run_file_says_what_it_needs(path: Path, tmp_path: Path) -> None:
    config = load_config(path)
    module, params = analysis_of(config)
    listed = members(config)
    ours = path.stem in ("correspondence", "shots")
    assert config.file.name == path.stem and (params.paper or ours) and len(listed) > 1
    if config.file.dataset["kind"] == "folder":
        shared("textured/sweethome3d")
    for member in listed[:2]:
        outputs = str(module.needs(params)).replace("'", '"')
        plan = Run.load(path, (*member.overrides, f"outputs={outputs}"), str(tmp_path)).plan()
        assert plan.to_run() and not plan.problems


def test_a_sweep_is_one_with_itself_and_falls_with_distance(tmp_path: Path) -> None:
    table, page = analysed("distance", tmp_path, {"sweep": '{"stages.render.distance_factor" = [3, 1, 1.5]}'})
    assert table["distance"].tolist() == [1, 1.5, 3], "sorted"
    assert table["cosine"][0] == pytest.approx(1) and table["sd"][0] == pytest.approx(0, abs=1e-6)
    assert 1 > table["cosine"][1] > table["cosine"][2]
    assert "almost linear relationship" in page and "<script src" not in page and '<link rel="stylesheet' not in page, (
        "self-contained"
    )


def test_views_are_counted(tmp_path: Path) -> None:
    table, _ = analysed(
        "views", tmp_path, {"sweep": '{"stages.render.rings.count" = [1, 2]}', "analysis.reference": "2"}
    )
    assert table["views"].tolist() == [6, 14] and table["cosine"][1] == pytest.approx(1) and table["cosine"][0] < 0.999


def test_features_feel_the_dent_and_hks_does_not(tmp_path: Path) -> None:
    table, page = analysed(
        "isometric", tmp_path, {"dataset.pairs": '["boxes"]', "stages.render.resolution": "96", "dataset.points": "256"}
    )
    means = table.pivot_table("difference", "descriptor", "zone")
    assert means.loc[["HKS", "WKS"]].max(axis=None) < 0.02
    assert means.loc["features", "changed"] > 1.5 * means.loc["features", "> 0.3"]
    assert means.loc["SHOT", "> 0.3"] < 0.01 and means.loc["SHOT", "changed"] > 0.5
    assert page.count("data:image/webp") == 4 * 2


@pytest.mark.parametrize(
    ("name", "columns"), [("semantic", ["descriptor", "class", "AUC"]), ("pca", ["class", "descriptor", "shapes"])]
)
def test_classes_are_analysed(name: str, columns: list[str], tmp_path: Path) -> None:
    table, page = analysed(name, tmp_path)
    assert (
        table.columns.tolist()[:3] == columns
        and set(table["class"]) == {"mug"}
        and {"features", "HKS"} <= set(table["descriptor"])
    )
    assert "<h1>" in page and table.select_dtypes("number").notna().all(axis=None)


def test_bad_scans_are_compared_with_the_same_shapes_clean(tmp_path: Path) -> None:
    variants = {
        "clean": {},
        "shuffled": {"dataset.damage.kind": "shuffled", "dataset.damage.amount": 0},
        "holes": {"dataset.damage.kind": "holes", "dataset.damage.amount": 0.7},
    }
    more = {
        "variants": json.dumps(variants), "dataset.classes": '["chair"]', "dataset.count": "5",
        "dataset.damage.clean": "3", "shots.count": "2",
    }  # fmt: skip
    table, page = analysed("robustness", tmp_path, more)
    rows = table.set_index("scan")
    assert (rows["shapes"] == 2).all() and rows.loc[["clean", "shuffled"], "left"].tolist() == [1, 1]
    assert rows["PCK"]["clean"] == rows["clean"]["clean"] and rows["change"]["clean"] == 0
    assert rows["left"]["holes"] < 0.9
    assert page.count("sd over 2 draws of shots") == 2
    table, page = analysed("robustness", tmp_path, {**more, "shots.draws": "[0]"})
    assert table["PCK sd"].isna().all() and page.count("of 1 draw of shots") == 2
    assert "sd over" not in page and '"error_y":{"array"' not in page
    assert page.count("data:image/webp") == 2 * 2 * 2, "two damages, two shapes, before and after"


def test_robustness_needs_a_clean_run_to_compare_with(tmp_path: Path) -> None:
    path, overrides = tiny("robustness", tmp_path)
    more = ['variants={"holes" = {"dataset.damage.kind" = "turned"}}', "dataset.damage.clean=1", "shots.count=1"]
    with pytest.raises(ValueError, match=r'expected a variant with dataset\.damage\.kind = "none"'):
        analyse(path, [*overrides, *more], str(tmp_path / "store"), workers=0)
    path, overrides = tiny("pca", tmp_path)
    with pytest.raises(ValueError, match="got pairs"):
        more = ['dataset={"kind" = "pairs"}', 'analysis={"kind" = "robustness"}']
        analyse(path, more, str(tmp_path / "store"), workers=0)


def test_the_report_links_to_the_analysis(tmp_path: Path) -> None:
    from b23d.stages.workbench.report.writing import write_report

    path, overrides = tiny("pca", tmp_path)
    run = Run.load(path, [*overrides, 'outputs=["reweight"]'], str(tmp_path / "store"))
    run.execute(workers=0)
    assert "analysis.html" not in write_report(run).page.read_text()
    (run.folder / "analysis.html").write_text("")
    assert '<a href="analysis.html">' in write_report(run).page.read_text()
    assert '<a href="pca/analysis.html">' in write_report(run, tmp_path / "other.html").page.read_text()


def test_members_are_a_sweep_s_values_and_the_variants(tmp_path: Path) -> None:
    variants = '{"HKS" = {"feeds.backproject" = "describe", "shots.count" = 1}, "plain" = {}}'
    path, _ = tiny("pca", tmp_path)
    listed = members(
        load_config(path, [f"variants={variants}", 'sweep={"stages.render.rings.count" = [1, 2]}', "shots.count=2"])
    )
    assert [member.label for member in listed] == [
        "stages.render.rings.count = 1",
        "stages.render.rings.count = 2",
        "HKS",
        "plain",
    ]
    hks = load_config(path, listed[2].overrides)
    assert hks.file.feeds == {"backproject": "describe"} and hks.file.shots.count == 1, (
        "a variant sets over what is set throughout"
    )
    assert load_config(path, listed[3].overrides).file.shots.count == 2


def test_errors_say_what_to_do(tmp_path: Path) -> None:
    path, overrides = tiny("views", tmp_path)
    for more, words in (
        (
            "analysis.kind=stabilty",
            "expected one of correspondence, .*, stability, got 'stabilty'",
        ),
        ("analysis.refrence=1", r"^--set analysis.refrence=1: .* got 'refrence'; did you mean 'reference'"),
        ("analysis.reference=many", r"^--set analysis.reference=many: reference: expected a number, got 'many'"),
    ):
        with pytest.raises(RunFileError, match=words):
            analyse(path, [*overrides, more], str(tmp_path / "store"), workers=0)
    with pytest.raises(
        ValueError, match=r"analysis.reference: expected one of the swept values 1, got 9.0; sweep it, too"
    ):
        analyse(
            path,
            [*overrides, "analysis.reference=9", 'sweep={"stages.render.rings.count" = [1]}'],
            str(tmp_path / "store"),
            workers=0,
        )
    path, overrides = tiny("pca", tmp_path)
    with pytest.raises(ValueError, match="expected a cloud whose points correspond"):
        analyse(path, [*overrides, 'analysis={"kind" = "similarity"}'], str(tmp_path / "store"), workers=0)


@pytest.mark.slow
def test_textured_chairs(tmp_path: Path) -> None:
    root = shared("textured/sweethome3d")
    more = {
        "dataset.root": f'"{root}"',
        "shots.draws": "[0]",
        "stages.render.resolution": "96",
        "stages.normalize.count": "512",
    }
    table, page = analysed("textured", tmp_path, more)
    assert table["variant"].tolist() == ["grey", "textured"] and (table["IoU .10"] > 0.2).all()
    assert page.count("data:image/webp") == 2 * 15
