"""A tiny data set and three stages that know no 3D, to test the engine with: text files of numbers, squared and
summed."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from b23d.pipeline.dataset import Dataset, Leaf, Shape, dataset
from b23d.pipeline.stage import Hints, stage
from b23d.schemas.artifact import ArraySpec, Artifact
from b23d.schemas.params import Params


class Numbers(Artifact):
    values: Annotated[np.ndarray, ArraySpec("n", "float64")]
    grid: Annotated[np.ndarray, ArraySpec("view n", "float32", sharded=True)] | None = None
    note: str = ""


def load_numbers(files: dict[str, bytes], values: dict[str, Any]) -> Numbers:
    return Numbers(values=np.array(files["numbers.txt"].decode().split(), float), note=values.get("note", ""))


def load_answer(files: dict[str, bytes], values: dict[str, Any]) -> Numbers:
    return Numbers(values=np.array([values["answer"]], float))


@dataset("toy")
class Toy(Dataset):
    kind: Literal["toy"]
    root: Path

    def shapes(self) -> list[Shape]:
        found = []
        for path in sorted(self.root.glob("*.txt")):
            leaves = {
                "numbers": Leaf(load_numbers, files={"numbers.txt": path}),
                "keypoints": Leaf(load_answer, {"answer": 1}),
            }
            found.append(Shape(path.stem, "toy", leaves))
        return found


class SquareParams(Params):
    power: float = 2.0
    pause: float = 0.0


@stage(version=1)
def square(numbers: Numbers, params: SquareParams) -> Numbers:
    time.sleep(params.pause)
    if numbers.values.size and numbers.values[0] == -13:
        raise ValueError("numbers: expected none to be unlucky, got -13; choose another")
    if numbers.values.size and numbers.values[0] == -99:
        os.kill(os.getpid(), 9)
    powered = numbers.values**params.power
    return Numbers(values=powered, grid=np.stack([powered, -powered]).astype(np.float32), note=f"power {params.power}")


class ShiftParams(Params):
    by: float = 1.0


@stage(version=1)
def shift(square: Numbers, params: ShiftParams) -> Numbers:
    return Numbers(values=square.values + params.by)


class AddParams(Params):
    weight: float = 1.0


@stage(version=1)
def add(shift: Numbers, shot_shift: list[Numbers], shot_keypoints: list[Numbers], params: AddParams) -> Numbers:
    return Numbers(values=shift.values + params.weight * sum(shot.values.sum() for shot in shot_shift))


@stage(version=1)
def total(shot_shift: list[Numbers], shot_keypoints: list[Numbers], params: AddParams) -> Numbers:
    return Numbers(values=np.array([sum(shot.values.sum() for shot in shot_shift)]))


@stage(version=1)
def use(shift: Numbers, total: Numbers, params: AddParams) -> Numbers:
    return Numbers(values=shift.values + total.values)


@stage(version=1, hints=Hints(gpu="required"))
def needs_gpu(numbers: Numbers, params: ShiftParams) -> Numbers:
    return numbers


RUN = """
name = "toy"
outputs = ["add"]
[dataset]
kind = "toy"
root = "numbers"
[shots]
count = 2
draws = [0, 1]
[store]
root = "{store}"
"""


def make_toy(folder: Path, count: int = 6, extra: str = "") -> Path:
    """A toy data set and its run file in `folder`; returns the run file."""
    (folder / "numbers").mkdir(exist_ok=True)
    for i in range(count):
        (folder / "numbers" / f"s{i}.txt").write_text(" ".join(str(i + j) for j in range(4)))
    path = folder / "toy.toml"
    path.write_text(RUN.format(store=folder / "store") + extra)
    return path


@dataset("idle")
class Idle(Dataset):
    """Shapes that are numbers, for stages that do nothing: what is left is the engine."""

    kind: Literal["idle"]
    count: int = 1

    def shapes(self) -> list[Shape]:
        leaf = [Leaf(load_answer, values={"answer": i}) for i in range(self.count)]
        return [Shape(f"s{i}", "idle", {"numbers": leaf[i]}) for i in range(self.count)]


class IdleParams(Params):
    """Of stages that give what they get."""


def _idle(name: str, upstream: str) -> None:
    def function(**given: Any) -> Numbers:
        return Numbers(values=given[upstream].values + 1)

    function.__name__ = name
    function.__annotations__ = {upstream: Numbers, "params": IdleParams, "return": Numbers}
    stage(version=1)(function)


for _i in range(8):
    _idle(f"idle{_i}", f"idle{_i - 1}" if _i else "numbers")


def make_idle(folder: Path, count: int, store: str = "store") -> Path:
    """A run file of eight stages in a chain that do nothing, over `count` shapes."""
    path = folder / f"idle-{count}.toml"
    path.write_text(
        f'name = "idle"\noutputs = ["idle7"]\n[dataset]\nkind = "idle"\ncount = {count}\n'
        f'[store]\nroot = "{folder / store}"\n'
    )
    return path
