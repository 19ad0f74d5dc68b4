"""Making a plan: which nodes a run wants, their addresses, and what state each is in."""

from __future__ import annotations

import gc

from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import naming
from b23d.pipeline.planning.acceptance import versions_accepted
from b23d.pipeline.planning.draws import Draw, draw_problems, draw_shots, unannotated_classes
from b23d.pipeline.planning.nodes import MISSING, SHOTS, LeafNode, Node, State
from b23d.pipeline.planning.plan import ByAddress, ByShape, Plan
from b23d.pipeline.planning.planner import Accepting, Planner
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.runfile.config import Config, needed_for
from b23d.pipeline.storage.index import Failure, Index
from b23d.pipeline.store import Store


def make_plan(
    config: Config,
    shapes: list[Shape],
    store: Store,
    index: Index,
    selection: Selection = EVERYTHING,
    accepting: Accepting | None = None,
) -> Plan:
    """Plan a run over `shapes`; a selection narrows targets and stages (draws and addresses stay what they are).

    `accepting`: besides what the store says. Raises SelectionError where it names what the run has not.
    """
    collecting = gc.isenabled()
    gc.disable()  # hundreds of thousands of live objects, no garbage: the collector would take a third of the time
    try:
        accepted = {**versions_accepted(store, config.stages), **(accepting or {})}
        return _make_plan(config, shapes, Planner(config, store, index, accepted), selection)
    finally:
        if collecting:
            gc.enable()


def _make_plan(config: Config, shapes: list[Shape], planner: Planner, selection: Selection) -> Plan:
    selection.check_stages(list(config.stages))
    planner.choose_examples(shapes)
    unusable = _plan_what_needs_no_shots(planner, shapes)
    draws = draw_shots(shapes, config.file.shots, unusable, planner.shot_leaves())
    targets = selection.targets(shapes, {failure.shape for failure in planner.quarantined.values()})
    _plan_targets(planner, draws, targets)

    serving = [draw for draw in draws if not selection.narrows or any(t.name in targets for t in draw.targets)]
    wanted = targets | {shot.name for draw in serving for shot in draw.shots}
    by_shape = {key: node for key, node in planner.by_shape.items() if key[1] in wanted}
    nodes = {(node.stage, node.recipe): node for node in by_shape.values()}
    for node in nodes.values():
        planner.settle(node)
    by_shape, nodes = _only_selected(config, selection, targets, by_shape, nodes)

    asked = _asked(config, selection)
    unannotated = _unannotated(shapes, planner, asked)
    problems = _problems(shapes, draws, planner, asked, unannotated)
    about = {shape.category for shape in shapes if shape.name in targets}
    bare = unannotated_classes(shapes, config.file.shots, planner.shot_leaves(asked))
    bare = {category: lack for category, lack in bare.items() if category in about}
    planner.index.save_digests()
    stages = [name for name in config.stages if name in _stages(config, selection)]
    return Plan(stages, nodes, by_shape, draws, planner.contents, problems, unannotated, bare)


def _plan_what_needs_no_shots(planner: Planner, shapes: list[Shape]) -> set[str]:
    """Nodes of every shape up to where shots come in; returns the names of the shapes that cannot be shots."""
    unusable = {shape.name for shape in shapes if shape.error}
    stages = [name for name in planner.config.stages if not planner.sees_shots[name]]
    for shape in shapes:
        for stage in stages:
            node = planner.node(stage, shape, None)
            if node is not None and (node.state is State.BLOCKED or _broken(node, planner.quarantined)):
                unusable.add(shape.name)
    return unusable


def _plan_targets(planner: Planner, draws: list[Draw], targets: set[str]) -> None:
    stages = [name for name in planner.config.stages if planner.sees_shots[name]]
    for draw in draws:
        for stage in stages:
            for shape in draw.targets:
                if shape.name in targets:
                    planner.node(stage, shape, draw)


def _stages(config: Config, selection: Selection) -> set[str]:
    if selection.stages:
        return set(selection.stages)
    return needed_for(config, selection.until) if selection.until else set(config.stages)


def _asked(config: Config, selection: Selection) -> set[str]:
    """The stages that a selection is about, and all that they need, stored or not."""
    named = selection.stages or ((selection.until,) if selection.until else ())
    return set().union(*(needed_for(config, name) for name in named)) if named else set(config.stages)


def _only_selected(
    config: Config, selection: Selection, targets: set[str], by_shape: ByShape, nodes: ByAddress
) -> tuple[ByShape, ByAddress]:
    """What the selection asks for of settled nodes: some stages only, and to run again where it is forced."""
    stages = _stages(config, selection)
    chosen = {key: node for key, node in by_shape.items() if key[0] in stages}
    kept = {(node.stage, node.recipe): node for node in chosen.values()}
    if selection.force:
        forced = {(node.stage, node.recipe) for (_, shape, _), node in chosen.items() if shape in targets}
        for node in (kept[key] for key in kept if key in forced):
            if node.state is State.CACHED:
                node.state, node.forced = State.RUN, True
    if selection.stages:
        for node in kept.values():
            if node.state is State.RUN and (missing := _missing_above(node, kept)):
                node.state = State.BLOCKED
                node.reason = (
                    f"{node.shape}: {node.stage} needs {missing}, which is not stored; use --until {node.stage}"
                )
    return chosen, kept


def _missing_above(node: Node, kept: ByAddress) -> str | None:
    """A stage above that would have to run first and is not among those kept, looking through transient stages."""
    for above in node.upstream():
        if isinstance(above, LeafNode) or above.state is State.CACHED:
            continue
        if above.state is State.TRANSIENT:
            if missing := _missing_above(above, kept):
                return missing
        elif (above.stage, above.recipe) not in kept:
            return above.stage
    return None


def _unannotated(shapes: list[Shape], planner: Planner, stages: set[str]) -> bool:
    """Whether these stages ask for annotations, and no shape has any."""
    checked = {planner.config.stages[name].checks for name in stages} & planner.shot_leaves()
    wanted = planner.shot_leaves(stages) | checked
    return bool(wanted) and not any(wanted & shape.leaves.keys() for shape in shapes)


def _problems(
    shapes: list[Shape], draws: list[Draw], planner: Planner, stages: set[str], unannotated: bool
) -> list[Failure]:
    """What is wrong before anything runs, as far as these stages need it: unusable shapes, draws without shots, files
    that cannot be read."""
    taken = {source for name in stages for source in planner.sources[name].values()}
    listed = [
        Failure("source", shape.name, MISSING, naming(shape.name, shape.error), True)
        for shape in shapes
        if shape.error and (not shape.about or shape.about in taken)
    ]
    told = draw_problems(shapes, planner.config.file.shots, draws, planner.shot_leaves(stages))
    if unannotated:
        told |= {said: True for said in [planner.config.dataset.unannotated()] if said}
    undrawn = [
        Failure(SHOTS if mistaken else "draw", one.split(":")[0], MISSING, f"ValueError: {one}", True)
        for one, mistaken in told.items()
    ]
    lost = {shape: leaf.error for (shape, name), leaf in planner.leaves.items() if leaf.error and name in taken}
    unread = [Failure("source", shape, MISSING, error, True) for shape, error in lost.items()]
    return [*listed, *undrawn, *unread]


def _broken(node: Node, quarantined: dict[str, Failure]) -> bool:
    failure = quarantined.get(node.recipe)
    return (failure is not None and failure.permanent) or any(
        isinstance(above, LeafNode) and above.error for above in node.upstream()
    )
