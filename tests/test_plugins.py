"""A stage in a file of one's own: in this process, in workers, edited, broken."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from b23d.pipeline.dataset import DATASETS
from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.stage import STAGES
from tests.small_runs import b23d
from tests.toy import Numbers, make_toy

MY_STAGE = """
import numpy as np
from b23d.pipeline.stage import stage
from b23d.schemas.artifact import Artifact
from b23d.schemas.params import Params
from tests.toy import Numbers


class TripleParams(Params):
    factor: float = 3.0


@stage(version=1)
def triple(shift: Numbers, params: TripleParams) -> Numbers:
    return Numbers(values=shift.values * params.factor)
"""
PLUGIN = '\n[plugins]\nmodules = ["mine/my_stage.py"]\n'


@pytest.fixture
def toy(tmp_path: Path) -> Iterator[Path]:
    """A run whose output is made by a stage of its own."""
    path = make_toy(tmp_path, 3, PLUGIN)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "my_stage.py").write_text(MY_STAGE)
    path.write_text(path.read_text().replace('outputs = ["add"]', 'outputs = ["triple"]'))
    yield path
    STAGES.pop("triple", None)


@pytest.mark.parametrize("workers", [0, 2])
def test_its_stage_runs_like_all_others(toy: Path, workers: int) -> None:
    run = Run.load(toy, ["stages.triple.factor=10"])
    report = run.execute(workers=workers)
    assert report.ok, report.failures
    found = run.artifact("toy/s1", "triple")
    assert isinstance(found, Numbers)
    np.testing.assert_array_equal(found.values, 10 * (np.arange(1, 5) ** 2.0 + 1))
    assert not Run.load(toy, ["stages.triple.factor=10"]).plan().to_run()


def test_its_address_is_name_version_and_params_alone(toy: Path) -> None:
    first = Run.load(toy).node("toy/s1", "triple").address
    file = toy.parent / "mine" / "my_stage.py"
    file.write_text(MY_STAGE + "\n# a comment\n")
    assert Run.load(toy).node("toy/s1", "triple").address == first
    file.write_text(MY_STAGE.replace("version=1", "version=2"))
    assert Run.load(toy).node("toy/s1", "triple").address != first, "read again, and the old declaration is gone"


def test_the_command_line_knows_it(toy: Path) -> None:
    assert "triple" in b23d("run", str(toy), "--workers", "0")
    assert "triple" in b23d("plan", str(toy))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("import nothing_like_this\n", "my_stage.py:1: ModuleNotFoundError"),
        ("x = 1\ndef f(:\n", "my_stage.py:2: SyntaxError"),
        (MY_STAGE.replace("def triple", "def shift"), "expected one declaration, got a second"),
        ("x = 1\n\nraise ValueError('no')\n", "my_stage.py:3: ValueError: no; mend the module"),
    ],
)
def test_what_is_wrong_with_it_is_said_with_its_line(toy: Path, source: str, message: str) -> None:
    (toy.parent / "mine" / "my_stage.py").write_text(source)
    known = dict(STAGES)
    with pytest.raises(RunFileError, match=message):
        load_config(toy)
    assert {name: s for name, s in STAGES.items() if name != "triple"} == {
        n: s for n, s in known.items() if n != "triple"
    }


def test_a_missing_file_and_a_package_are_refused(toy: Path) -> None:
    for name, message in (("gone.py", "expected a Python file"), ("numpy", "expected Python files, got numpy")):
        toy.write_text(toy.read_text().replace("mine/my_stage.py", name))
        with pytest.raises(RunFileError, match=message):
            load_config(toy)
        toy.write_text(toy.read_text().replace(name, "mine/my_stage.py"))


def test_it_may_declare_a_data_set(tmp_path: Path) -> None:
    (tmp_path / "data.py").write_text(
        "from typing import Literal\nfrom b23d.pipeline.dataset import Dataset, Leaf, Shape, dataset\n"
        "from tests.toy import load_answer\n\n\n@dataset('answers')\nclass Answers(Dataset):\n"
        "    kind: Literal['answers']\n\n    def shapes(self):\n"
        "        return [Shape(str(i), 'a', {'numbers': Leaf(load_answer, {'answer': i})}) for i in range(3)]\n"
    )
    path = tmp_path / "run.toml"
    path.write_text(
        f'name = "answers"\noutputs = ["shift"]\n[dataset]\nkind = "answers"\n[plugins]\nmodules = ["data.py"]\n'
        f'[store]\nroot = "{tmp_path / "store"}"\n'
    )
    try:
        run = Run.load(path)
        assert run.execute(workers=0).ok
        found = run.artifact("a/2", "shift")
        assert isinstance(found, Numbers) and found.values.tolist() == [5.0]
    finally:
        DATASETS.pop("answers", None)
