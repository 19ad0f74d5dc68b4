"""The discrete solver against the paper's optimiser, on every target of every draw of a run whose store has what
`optimize` needs:

    python tests/benchmarks/bench_objectives.py RUN [--set a.b=value]… [--steps 5000] [--per-class N] [--store PATH]

Per class: how many problems, both mean objectives of the chosen candidates, on how many the discrete one is worse,
seconds of each a problem (the softmax solves all draws of one target together), and the AUC of label-agnostic IoU with
every id predicted. Exits with 1 where the discrete solver is worse on any.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import groupby
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d import load
from b23d.schemas.scores import ShapeScore
from b23d.stages.optimize import OptimizeParams
from b23d.stages.solvers.discrete import discrete
from b23d.stages.solvers.learn_options import LearnParams
from b23d.stages.solvers.objective import objective
from b23d.stages.solvers.softmax import softmax
from tests.benchmarks.run_problems import Posed, area, posed

ROUNDING = 1e-6
"""Relative: what float32 sweeps may leave between two equal choices."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="?", help="run file")
    parser.add_argument("--set", action="append", default=[], metavar="a.b=value")
    parser.add_argument("--store")
    parser.add_argument("--steps", type=int, default=5000, help="Adam steps of the softmax (the paper: 5,000)")
    parser.add_argument("--per-class", type=int, help="only so many shapes of each class")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    if options.run is None:
        print("skipped: give a run file whose store has features")
        return 0
    import torch

    torch.set_num_threads(options.threads)
    run = load(options.run, *options.set, 'outputs=["optimize"]', store=options.store)
    params = run.config.params["optimize"]
    assert isinstance(params, OptimizeParams)
    template = run.config.params["learn"]
    assert isinstance(template, LearnParams)
    print(
        f"{run.name}: alpha {params.alpha:g}, features {template.template.features}, {options.steps} Adam steps, "
        f"{options.threads} threads"
    )
    print(
        f"{'class':14} {'problems':>8} {'discrete':>9} {'softmax':>9} {'worse':>6} {'s':>7} {'s':>8} {'AUC':>6} "
        f"{'AUC':>6}",
        flush=True,
    )
    worse = 0
    for category, problems in groupby(posed(run, options.per_class), key=lambda one: one.category):
        rows = [
            row
            for _, draws in groupby(problems, key=lambda one: one.shape)
            for row in compare(list(draws), params, options.steps)
        ]
        reached = np.array([row[0] for row in rows])  # (problem, solver)
        seconds = np.array([row[1] for row in rows]).mean(0)
        lost = int((reached[:, 0] > reached[:, 1] * (1 + ROUNDING)).sum())
        means, auc = reached.mean(0), [area([row[2][i] for row in rows]) for i in range(2)]
        figures = (
            f"{means[0]:9.4f} {means[1]:9.4f} {lost:6} {seconds[0]:7.3f} {seconds[1]:8.2f} {auc[0]:6.3f} {auc[1]:6.3f}"
        )
        print(f"{category:14} {len(rows):8} {figures}", flush=True)
        worse += lost
    return int(worse > 0)


def compare(
    draws: list[Posed], params: OptimizeParams, steps: int
) -> list[tuple[list[float], list[float], list[ShapeScore | None]]]:
    """For every draw of one target: objectives, seconds and scores of both solvers."""
    choices: list[list[np.ndarray]] = []
    started = time.perf_counter()
    choices.append([discrete(one.problem, starts=params.discrete.starts, seed=params.discrete.seed) for one in draws])
    between = time.perf_counter()
    options = {"beta": params.softmax.beta, "learning_rate": params.softmax.learning_rate, "seed": params.softmax.seed}
    choices.append([softmax(one.problem, steps=steps, **options) for one in draws])
    seconds = [(between - started) / len(draws), (time.perf_counter() - between) / len(draws)]
    return [
        ([float(objective(one.problem, c)) for c in pair], seconds, [one.score(c) for c in pair])
        for one, *pair in zip(draws, *choices, strict=True)
    ]


if __name__ == "__main__":
    sys.exit(main())
