"""Time and objective of every solver, and of other libraries' (`outside_solvers.py`), on made problems or on the
targets of a run:

    python tests/benchmarks/bench_solvers.py [--steps 5000] [--instances 3] [--run RUN [--set a.b=value]… [--per-class
    3] [--draws 2]]

Made problems have 10 keypoints and 2,048 candidates: points of a mirror-symmetric box with smooth features that cannot
tell left from right, and keypoints of a somewhat different box, as a shot would give them. "better" and "worse": on how
many problems than the discrete solver with 32 starts.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.schemas.scores import ShapeScore
from b23d.stages.solvers.discrete import discrete
from b23d.stages.solvers.hungarian import hungarian
from b23d.stages.solvers.nearest import nearest
from b23d.stages.solvers.objective import Problem, objective
from b23d.stages.solvers.scaling import scale_features
from tests.benchmarks.outside_solvers import Solver, outside_solvers
from tests.benchmarks.run_problems import Posed, area, posed

CHANNELS = 384
REFERENCE = "discrete, 32 starts"


def instance(seed: int, n: int = 2048, k: int = 10, alpha: float = 0.25) -> Problem:
    random = np.random.default_rng(seed)
    points = random.uniform(-0.5, 0.5, (n, 3)) * [1, 0.6, 0.3]
    waves = random.normal(size=(3, CHANNELS)) * 4
    keypoints = random.choice(n, k, replace=False)
    stretched = points[keypoints] * random.uniform(0.8, 1.2, 3)

    def features(places: np.ndarray) -> np.ndarray:
        sides = np.column_stack([np.abs(places[:, 0]), places[:, 1:]])
        return np.cos(sides @ waves + np.arange(CHANNELS)) + 0.5 * random.normal(size=(len(places), CHANNELS))

    shot = np.concatenate([features(points), features(stretched)])
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    wanted = np.linalg.norm(stretched[:, None] - stretched[None], axis=2)
    return Problem(
        features=scale_features(features(points), "centred-unit"),
        distances=(distances / distances.max()).astype(np.float32),
        target_features=scale_features(shot, "centred-unit")[n:],
        target_distances=wanted / distances.max(),
        mask=~np.eye(k, dtype=bool),
        alpha=alpha,
    )


def solvers(steps: int) -> dict[str, Solver]:
    named: dict[str, Solver] = {"nearest": nearest, "hungarian": hungarian}
    for starts in (2, 32, 512):
        named[f"discrete, {starts} starts"] = lambda problem, starts=starts: discrete(problem, starts=starts)
    if steps:
        from b23d.stages.solvers.softmax import softmax

        named[f"softmax, {steps} steps"] = lambda problem: softmax(problem, steps=steps)
    return {**named, **outside_solvers()}


def compare(title: str, problems: Iterator[tuple[Problem, Posed | None]], named: dict[str, Solver]) -> None:
    """Solve every problem with every solver, and print a table."""
    seconds: dict[str, list[float]] = {name: [] for name in named}
    reached: dict[str, list[float]] = {name: [] for name in named}
    scores: dict[str, list[ShapeScore | None]] = {name: [] for name in named}
    for problem, target in problems:
        for name, solve in named.items():
            fresh = replace(problem)  # what one solver caches is no gift to the next
            start = time.perf_counter()
            choice = solve(fresh)
            seconds[name].append(time.perf_counter() - start)
            reached[name].append(float(objective(problem, choice)))
            scores[name].append(None if target is None else target.score(choice))
    values, least = np.array(list(reached.values())), np.array(reached[REFERENCE])
    best = values.min(0)
    print(f"{title}, {len(least)} problems")
    print(f"{'solver':22} {'seconds':>9} {'objective':>10} {'/ best':>8} {'better':>7} {'worse':>6} {'AUC':>6}")
    for name, row in zip(named, values, strict=True):
        better, worse = int((row < least * (1 - 1e-6)).sum()), int((row > least * (1 + 1e-6)).sum())
        figures = f"{np.median(seconds[name]):9.3f} {row.mean():10.4f} {np.mean(row / best):8.4f} {better:7} {worse:6}"
        print(f"{name:22} {figures} {area(scores[name]):6.3f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5000, help="Adam steps of the softmax; 0 leaves it out")
    parser.add_argument("--instances", type=int, default=3)
    parser.add_argument("--run", help="run file whose store has features")
    parser.add_argument("--set", action="append", default=[], metavar="a.b=value")
    parser.add_argument("--per-class", type=int, default=3)
    parser.add_argument("--draws", type=int, default=2)
    options = parser.parse_args()
    named = solvers(options.steps)
    if options.run is None:
        for alpha in (0.25, 1.0):
            made = ((instance(seed, alpha=alpha), None) for seed in range(options.instances))
            compare(f"alpha {alpha:g}, 10 keypoints, 2,048 candidates", made, named)
    else:
        from b23d import load

        run = load(options.run, *options.set, 'outputs=["optimize"]')
        targets = posed(run, options.per_class)
        compare(run.name, ((one.problem, one) for one in targets if one.draw < options.draws), named)


if __name__ == "__main__":
    main()
