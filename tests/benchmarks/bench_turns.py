"""What it costs that shapes do not stand alike: labelled PCK .10 and AUC of procedural classes as they are, turned at
random about the up axis, and turned and toppled among six axes, beside each other.

    python tests/benchmarks/bench_turns.py [--classes chair …] [--count 16] [--draws 0 1 2] [--views few|default]
                                           [--ways aligned turned …] [--store FOLDER]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import trimesh

from b23d.pipeline.run import Run
from b23d.schemas.shape import turned
from b23d.schemas.up_axis import UP_AXES, to_y_up
from b23d.stages.datasets.procedural import generated
from b23d.stages.workbench.results.scores import run_scores

WAYS = ("aligned", "turned", "toppled", "toppled-declared", "toppled-as-it-is")
CLASSES = ("airplane", "chair", "mug", "table")
RUN = """
name = "{name}"
[dataset]
kind = "folder"
root = "{root}"
up = {up}
[shots]
count = 3
draws = {draws}
[stages.normalize]
turn = {turn}
{views}
[store]
root = "{store}"
transient = ["render", "extract"]
"""
FEW = """[stages.render]
resolution = 112
[stages.render.rings]
count = 2
"""


def write(folder: Path, rotations: dict[str, np.ndarray], classes: list[str], count: int) -> None:
    """A folder of meshes with their keypoints, each shape rotated."""
    entries = []
    for category in classes:
        (folder / category).mkdir(parents=True)
        for i in range(count):
            built, name = generated(category, 0, i), f"{i:02d}"
            rotation = rotations[f"{category}/{name}"]
            mesh = trimesh.Trimesh(built.vertices @ rotation, built.faces, process=False)
            mesh.export(folder / category / f"{name}.ply")
            points = [
                {"xyz": place.tolist(), "semantic_id": int(i)}
                for i, place in zip(built.keypoint_ids, built.keypoints @ rotation, strict=True)
            ]
            at = {int(i): place for place, i in enumerate(built.keypoint_ids)}
            symmetries = {
                kind: [{"kp_indexes": [at[i] for i in ids]} for ids in groups if at.keys() >= set(ids)]
                for kind, groups in (("reflection", built.reflections), ("rotation", built.rotations))
            }
            entries.append({"model_id": name, "class_id": category, "keypoints": points, "symmetries": symmetries})
    (folder / "keypoints.json").write_text(json.dumps(entries))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES))
    parser.add_argument("--count", type=int, default=16)
    parser.add_argument("--draws", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--views", choices=("few", "default"), default="few")
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--store", type=Path)
    options = parser.parse_args()
    names = [f"{category}/{i:02d}" for category in options.classes for i in range(options.count)]
    rng = np.random.default_rng(0)
    axes = {name: UP_AXES[rng.integers(6)] for name in names}
    toppled = {name: turned(rng.uniform(0, 360)).T @ to_y_up(axis) for name, axis in axes.items()}
    declared = "{ " + ", ".join(f'"{name}" = "{axis}"' for name, axis in axes.items()) + " }"
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write(folder / "upright", dict.fromkeys(names, np.eye(3)), options.classes, options.count)
        write(folder / "toppled", toppled, options.classes, options.count)
        before: dict[str, float] = {}
        ways = {
            "aligned": ("upright", '"y"', "0.0"),
            "turned": ("upright", '"y"', '"random"'),
            "toppled": ("toppled", '"auto"', "0.0"),
            "toppled-declared": ("toppled", declared, "0.0"),
            "toppled-as-it-is": ("toppled", '"y"', "0.0"),
        }
        for name in options.ways:
            root, up, turn = ways[name]
            path, store = folder / f"{name}.toml", options.store or folder / "store"
            views = FEW if options.views == "few" else ""
            values = {"root": root, "up": up, "turn": turn, "draws": options.draws, "views": views, "store": store}
            path.write_text(RUN.format(name=name, **values))
            run = Run.load(path)
            report = run.execute(workers=0)
            for failure in report.failures:
                print(failure.error)
            for category, scores in run_scores(run).classes.items():
                pck = scores.pck.mean[-1]
                before.setdefault(category, pck)
                print(
                    f"{name:<17} {category:<9} PCK {pck:.3f} ±{scores.pck.sd[-1]:.3f}, of {options.ways[0]} "
                    f"{pck / before[category]:.2f}; symmetric {scores.symmetric_pck.mean[-1]:.3f}; "
                    f"either front {scores.either_front_pck.mean[-1]:.3f}; "
                    f"AUC {scores.auc.mean:.3f} ±{scores.auc.sd:.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
