"""`b23d accept`: take what an older version of a stage made for what the new one would make."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from b23d.pipeline.verbs.options import RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console
from b23d.schemas.wording import counted

if TYPE_CHECKING:
    from b23d.pipeline.planning.nodes import Node
    from b23d.pipeline.run import Run


def accept(
    run: RunPath,
    stage: Annotated[str, typer.Argument(help="The stage whose version was raised.")],
    set: Set = [],
    store: StoreUrl = None,
    check: Annotated[int, typer.Option("--check", min=0, metavar="N", help="Make N anew first, and compare.")] = 0,
    yes: Annotated[bool, typer.Option("--yes", help="Do it; without, only say what would be linked.")] = False,
    revoke: Annotated[bool, typer.Option("--revoke", help="Take it back.")] = False,
) -> None:
    """ "The new version gives the same, by my word": links what older versions made, without recomputing."""
    from b23d.pipeline.inspection.proposing import proposed
    from b23d.pipeline.planning import acceptance
    from b23d.pipeline.planning.hinting import hint
    from b23d.pipeline.planning.nodes import State
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    installed = loaded.config.stages.get(stage)
    if installed is None:
        near = hint(stage, list(loaded.config.stages), "check the name")
        raise ValueError(f"stage: expected one of {', '.join(loaded.config.stages)}, got {stage!r}; {near}")
    version = installed.version
    if revoke:
        loaded.open_to_write()
        there = acceptance.revoke(loaded.store, stage, version)
        told = "is taken back" if there else "was not accepted"
        console.print(f"{stage} version {version} {told}", highlight=False, markup=False)
        return
    older = range(version - 1, 0, -1)
    before = loaded.plan()
    after = loaded.plan(accepting={stage: tuple(older)})
    linked = [
        node
        for node in after.nodes.values()
        if node.stage == stage and before.nodes[stage, node.recipe].state is State.RUN and node.state is State.CACHED
    ]
    spared = len(before.to_run()) - len(after.to_run())
    artifacts, fewer = counted(len(linked), "artifact"), counted(spared, "task")
    text = f"{artifacts} of {stage} would be linked to version {version}, {fewer} fewer to run"
    if not linked:
        console.print(
            f"nothing to accept: no artifact of an older {stage} fits this run", highlight=False, markup=False
        )
        return
    checked = linked[:check]
    for node in checked:
        _check(loaded, node)
    if checked:
        console.print(f"{len(checked)} made anew, and the same", highlight=False, markup=False)
    if not yes:
        console.print(f"{text}; --yes does it, --check N makes N anew first", highlight=False, markup=False)
        return
    loaded.open_to_write()
    acceptance.accept(loaded.store, stage, version, older, len(checked))
    done = text.replace("would be", "are")
    console.print(
        f"{done}; `{proposed('accept', loaded, stage, '--revoke')}` takes it back", highlight=False, markup=False
    )


def _check(run: Run, node: Node) -> None:
    """Make one anew and compare. Exits with 1 where it differs: then nothing is accepted."""
    from b23d.pipeline.inspection.comparing import differences
    from b23d.pipeline.inspection.trying import make

    found = differences(make(run, node), run.store.read(node.stage, node.address, run.config.stages[node.stage].gives))
    if found:
        first = escape(str(found[0]))
        console.print(f"[red]✗[/] {escape(node.shape)} differs, nothing is accepted: {first}", highlight=False)
        raise typer.Exit(1)
