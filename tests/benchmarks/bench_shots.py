"""Does annotating more help, and what does it cost? Scores and CPU seconds of `learn` and `optimize` with more and more
shots:

    python tests/benchmarks/bench_shots.py [--keypointnet ROOT] [--classes bathtub bed] [--shots 1 2 3 5 10 25 50]
        [--draws 0 1 2] [--every 1] [--store PATH]

Of procedural shapes (thirty of a class) or, where KeypointNet's folder is given, of its classes. What comes before is
made once and kept in the store. Per class: mean ± sd over draws of AUC and labelled PCK within .10; learning a draw,
and searching one target, in seconds, and as multiples of those with the fewest shots. Every draw is measured on what it
leaves over; with the most shots few targets may be left.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.pipeline.planning.draws import Draw
from b23d.pipeline.run import Run
from b23d.stages.learn import learn
from b23d.stages.optimize import optimize
from b23d.stages.score import ScoreParams, score
from b23d.stages.scoring.summary import ScoreRow, score_table
from b23d.stages.solvers.learn_options import LearnParams
from b23d.stages.solvers.options import OptimizeParams
from tests.benchmarks.stages import encoder

COUNT = 30
RUN = """
name = "shots"
[dataset]
{dataset}
classes = {classes}
[shots]
draws = {draws}
[stages.extract]
encoder = "{encoder}"
[store]
root = "{store}"
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keypointnet", type=Path, help="its folder, with annotations/ and pcds/")
    parser.add_argument("--classes", nargs="+")
    parser.add_argument("--shots", type=int, nargs="+", default=[1, 2, 3, 5, 10, 25, 50])
    parser.add_argument("--draws", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--every", type=int, default=1, help="measure on every so-manieth target")
    parser.add_argument("--store", type=Path, help="where to keep features; without it, they are made anew")
    options = parser.parse_args()
    if options.keypointnet is not None and not (options.keypointnet / "annotations").is_dir():
        print(
            f"skipped: {options.keypointnet} has no annotations/; `hf download qq456cvb/KeypointNet` gets the data set"
        )
        return 0
    if options.keypointnet is None:
        dataset, classes = f'kind = "procedural"\ncount = {COUNT}', options.classes or ["chair"]
    else:
        dataset, classes = f'kind = "keypointnet"\nroot = "{options.keypointnet}"', options.classes or ["bathtub"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shots.toml"
        store = options.store.resolve() if options.store else Path(folder) / "store"
        written = RUN.format(
            dataset=dataset, classes=str(classes), draws=options.draws, encoder=encoder(), store=store.as_posix()
        )
        path.write_text(written.replace("'", '"'))
        report = Run.load(path, ("shots.count=1", 'outputs=["reweight", "geodesic"]')).execute(workers=1)
        for failure in report.failures:
            print(f"left out: {failure.shape}: {failure.error}")
        for category in classes:
            _curve(path, category, options.shots, options.every)
    return 0


def _curve(path: Path, category: str, counts: list[int], every: int) -> None:
    print(f"\n{category:<12}{'AUC':>14}{'PCK .10':>16}{'learn':>10}{'×':>7}{'a target':>12}{'×':>7}{'targets':>9}")
    first = None
    for count in counts:
        run = Run.load(path, (f"shots.count={count}", 'outputs=["optimize"]'))
        draws = [draw for draw in run.plan().draws if draw.category == category and not draw.error and draw.targets]
        if not draws:
            print(f"{count:4}  skipped: the class has too few annotated shapes")
            continue
        found = [_draw(run, draw, every) for draw in draws]
        auc, pck, learning, searching, targets = (np.array(column) for column in zip(*found, strict=True))
        spent = float(learning.mean()), float(searching.mean())
        first = first or spent
        print(
            f"{count:4}        {_spread(auc)}   {_spread(pck)}{spent[0]:8.2f} s{spent[0] / first[0]:6.1f}"
            f"{spent[1]:10.3f} s{spent[1] / first[1]:6.1f}{int(targets.mean()):9}",
            flush=True,
        )


def _spread(values: np.ndarray) -> str:
    return f"{values.mean():.3f} ± {values.std(ddof=1) if len(values) > 1 else 0:.3f}"


def _draw(run: Run, draw: Draw, every: int) -> tuple[float, float, float, float, int]:
    """AUC, PCK within .10, CPU seconds of learning and of searching a target, and how many targets."""
    shots = [_known(run, shape.name) for shape in draw.shots]
    keypoints = [shape.leaves["keypoints"].read() for shape in draw.shots]
    started = time.process_time()
    model = learn(*(list(column) for column in zip(*shots, strict=True)), keypoints, LearnParams())
    learning, searching = time.process_time() - started, 0.0
    rows: list[ScoreRow] = []
    for target in draw.targets[::every]:
        normalize, reweight, geodesic = _known(run, target.name)
        started = time.process_time()
        prediction = optimize(normalize, reweight, geodesic, model, OptimizeParams())
        searching += time.process_time() - started
        judged = score(normalize, prediction, target.leaves["keypoints"].read(), keypoints, ScoreParams())
        rows.append((draw.category, draw.seed, target.name, judged))
    table = score_table(run.name, None, rows).mean
    return table.auc.mean, table.pck.mean[-1], learning, searching / len(rows), len(rows)


def _known(run: Run, name: str) -> list[Any]:
    """NormalizedShape, PointFeatures and GeodesicDistances, their arrays read: that is not what is measured."""
    known = [run.artifact(name, stage) for stage in ("normalize", "reweight", "geodesic")]
    for artifact in known:
        for array in artifact.array_specs():
            getattr(artifact, array)
    return known


if __name__ == "__main__":
    sys.exit(main())
