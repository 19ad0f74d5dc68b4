"""Time and objective of every solver: `python -m tests.benchmarks.bench_solvers [--steps 5000] [--instances 3]`.

Instances of 10 keypoints and 2,048 candidates: points of a mirror-symmetric box with smooth features that cannot tell left from
right, and keypoints of a somewhat different box, as a shot would give them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from stages.solvers.discrete import discrete
from stages.solvers.hungarian import hungarian
from stages.solvers.nearest import nearest
from stages.solvers.objective import Problem, objective
from stages.solvers.scaling import scale_features

CHANNELS = 384


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


def solvers(steps: int) -> dict[str, Callable[[Problem], np.ndarray]]:
    named: dict[str, Callable[[Problem], np.ndarray]] = {"nearest": nearest, "hungarian": hungarian}
    for starts in (2, 32, 256):
        named[f"discrete, {starts} starts"] = lambda problem, starts=starts: discrete(problem, starts=starts)
    if steps:
        from stages.solvers.softmax import softmax

        named[f"softmax, {steps} steps"] = lambda problem: softmax(problem, steps=steps)
    return named


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5000, help="Adam steps of the softmax; 0 leaves it out")
    parser.add_argument("--instances", type=int, default=3)
    options = parser.parse_args()
    named = solvers(options.steps)
    for alpha in (0.25, 1.0):
        seconds: dict[str, list[float]] = {name: [] for name in named}
        reached: dict[str, list[float]] = {name: [] for name in named}
        for seed in range(options.instances):
            for name, solve in named.items():
                problem = instance(seed, alpha=alpha)  # afresh: what one solver caches is no gift to the next
                start = time.perf_counter()
                choice = solve(problem)
                seconds[name].append(time.perf_counter() - start)
                reached[name].append(float(objective(problem, choice)))
        best = np.min(list(reached.values()), axis=0)
        print(f"alpha {alpha:g}, 10 keypoints, 2,048 candidates, {options.instances} instances")
        print(f"{'solver':22} {'seconds':>9} {'objective':>10} {'/ best':>8}")
        for name in named:
            ratio = float(np.mean(np.array(reached[name]) / best))
            print(f"{name:22} {np.median(seconds[name]):9.3f} {np.mean(reached[name]):10.4f} {ratio:8.4f}")


if __name__ == "__main__":
    main()
