"""What the columns of a comparison are headed with tells its two runs apart."""

from __future__ import annotations

from pathlib import Path

import pytest

from b23d.pipeline.records.history import records
from b23d.pipeline.run import Run
from b23d.stages.workbench.results.headings import headings
from tests.small_runs import b23d, make_boxes

DISCRETE = "stages.optimize.method=discrete"
LONG = f"outputs={['optimize'] * 9}"


def test_records_of_one_run_are_headed_by_their_ids_and_overrides(tmp_path: Path) -> None:
    path = str(make_boxes(tmp_path, 3))
    b23d("run", path, "--workers", "0")
    b23d("run", path, "--workers", "0", "--set", DISCRETE)
    store = Run.load(path).store
    first, second = sorted(record.id for record in records(store))
    lines = b23d("diff", first, second, "--store", store.url).splitlines()
    heads = [line for line in lines if first in line]
    assert len(heads) == 3 and not any("boxes" in line for line in lines)
    assert sum(second in line for line in lines) == sum(DISCRETE in line for line in lines) == 3


@pytest.mark.parametrize("overrides", [(), (DISCRETE,), (LONG,), (DISCRETE, LONG)])
def test_runs_of_one_file_differ_by_what_is_set(overrides: tuple[str, ...], tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    one, two = headings(Run.load(path, [LONG]), Run.load(path, overrides))
    assert (one == two) == (overrides == (LONG,))
    assert headings(Run.load(path), Run.load(path, [DISCRETE])) == ("boxes", f"boxes\n{DISCRETE}")


def test_files_that_call_the_run_alike_are_headed_by_their_paths(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    other = path.with_name("other.toml")
    other.write_text(path.read_text())
    assert headings(Run.load(path), Run.load(other)) == (str(path), str(other))
    other.write_text(path.read_text().replace('"boxes"', '"others"'))
    assert headings(Run.load(path), Run.load(other)) == ("boxes", "others")
