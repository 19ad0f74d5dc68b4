"""What the two columns of a comparison are headed with: what tells the two runs apart."""

from __future__ import annotations

from b23d.pipeline.run import Run

LONGEST = 60
"""Characters of overrides that a heading shows."""


def headings(one: Run, two: Run, records: tuple[str, str] = ("", "")) -> tuple[str, str]:
    """For each the record's id, or the run's name; and its own overrides where they are short.

    records: ids of the records that the runs were recorded under; "" for a run file. The two differ unless both are
    of one run file, as it stands.
    """
    bare = [record or run.name for run, record in zip((one, two), records, strict=True)]
    told = [f"{name}{_own(run, other)}" for name, run, other in zip(bare, (one, two), (two, one), strict=True)]
    if told[0] == told[1] and one.config.path != two.config.path:
        told = [str(run.config.path) for run in (one, two)]
    if told[0] == told[1] and one.config.overrides != two.config.overrides:
        told = [f"{name} ({place})" for place, name in enumerate(told, 1)]
    return told[0], told[1]


def _own(run: Run, other: Run) -> str:
    """The overrides that only this one has, a line each."""
    own = [text for text in dict.fromkeys(run.config.overrides) if text not in other.config.overrides]
    return "".join(f"\n{text}" for text in own) if own and sum(map(len, own)) <= LONGEST else ""
