"""Planning 8,000 shapes × 8 stages: with everything known, after a version bump, and after a lost index; prints CPU
seconds. A store of small artifacts is written first (a few minutes)."""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.pipeline.inspection.explain import explain
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from b23d.pipeline.stage import STAGES, stage
from b23d.pipeline.storage.index import Given
from tests.toy import Numbers, ShiftParams, make_toy

CHAIN = ["one", "two", "three", "four", "five", "six"]


def declare_chain() -> None:
    """Six more stages, one behind the other: numbers → square → shift → one → … → six."""
    for name, upstream in zip(CHAIN, ["shift", *CHAIN], strict=False):
        code = f"def {name}({upstream}: Numbers, params: ShiftParams) -> Numbers: ..."
        space: dict[str, object] = {"Numbers": Numbers, "ShiftParams": ShiftParams, "__name__": __name__}
        exec(code, space)
        stage(version=1)(space[name])  # type: ignore[type-var]


def fill(run: Run, values: dict[str, float]) -> None:
    """Store an artifact at every address of the plan that has none, with keys, as an execution would. `values`: what
    `shift` gives of each shape; what is not in it is filled in."""
    run.open_to_write()
    plan = run.plan()
    rows: dict[str, dict[str, Given]] = {name: {} for name in plan.stages}
    for count, node in enumerate(plan.to_run()):
        key = plan.contents.key(node)
        if node.behind and key and plan.contents.at(node.stage, key):
            continue  # spared
        value = values.setdefault(node.shape, float(count)) if node.stage == "shift" else float(count)
        made = {"stage": node.stage, "address": node.recipe, "inputs": {}, "seconds": 1.0}
        _, content = run.store.write(node.stage, node.recipe, Numbers(values=np.array([value])), made, key)
        node.state = State.CACHED
        rows[node.stage][node.recipe] = Given(content, key)
        plan.contents.note(node.stage, node.recipe, rows[node.stage][node.recipe])
    for name, found in rows.items():
        run.index.note_given(name, found)
    run.index.close()


def planned(label: str, path: Path, overrides: list[str]) -> None:
    started = time.process_time()
    plan = Run.load(path, overrides).plan()
    seconds = time.process_time() - started
    counts = {state.value: sum(n.state is state for n in plan.nodes.values()) for state in State}
    print(f"{label:<44} {seconds:.2f} CPU s for {len(plan.nodes)} nodes: {counts}, {plan.behind()} behind", flush=True)


if __name__ == "__main__":
    declare_chain()
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8000
    with tempfile.TemporaryDirectory() as folder:
        run_file, overrides = make_toy(Path(folder), count=count), ['outputs=["six"]']
        shifted: dict[str, float] = {}
        planned("files never digested", run_file, overrides)
        fill(Run.load(run_file, overrides), shifted)
        planned("everything known", run_file, overrides)
        STAGES["shift"] = replace(STAGES["shift"], version=2)
        planned("after a version bump", run_file, overrides)
        fill(Run.load(run_file, overrides), shifted)
        planned("after that stage has run and gave the same", run_file, overrides)
        started = time.process_time()
        explain(Run.load(run_file, overrides), "toy/s17", "six")
        print(f"{'explain':<44} {time.process_time() - started:.2f} CPU s")
        Path(folder, "store", "index.sqlite").unlink()
        planned("the same, the index lost", run_file, overrides)
