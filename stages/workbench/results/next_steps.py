"""What to do after a run, as commands for a shell: with what it has made, or about what it lacks."""

from __future__ import annotations

from b23d.pipeline.inspection.proposing import NAMED, proposed
from b23d.pipeline.inspection.unannotated import remedy
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Report, Run
from b23d.pipeline.runfile.config import feeding, needed_for
from b23d.schemas.wording import counted


def next_steps(run: Run, report: Report) -> list[tuple[str, str]]:
    """(command, what it gives) of each; none where nothing would come of one."""
    plan, selection = report.plan, report.selection
    if plan is None:
        return []
    made = {stage for (stage, _, _), node in plan.by_shape.items() if node.state is State.CACHED}
    asked, steps = feeding(run.config.file, "optimize") in plan.stages, []
    if asked and feeding(run.config.file, "optimize") in made:
        command = proposed("keypoints", run, "-o", f"{run.name}.csv", selection=selection)
        steps.append((command, "the keypoints in your files' coordinates"))
    elif asked and _annotating_helps(run, plan):
        steps.append((proposed("annotate", run), "click keypoints on a few shapes of each class"))
    elif made and not asked:
        command = proposed("list", run, selection=selection, taking=(*NAMED, "limit"))
        steps.append((command, "what there is of each shape, for b23d show to open or to write"))
    base = feeding(run.config.file, "normalize")
    if any(base in needed_for(run.config, stage) for stage in made):
        steps.append((proposed("report", run), "one page to look at them all"))
    return steps


def none_made(run: Run, selection: Selection, waiting: int) -> str:
    """Why there is not one prediction of what is selected, and what to do. waiting: shapes that could have one."""
    stage = feeding(run.config.file, "optimize")
    if stage not in run.config.stages:
        return f"outputs that need none; --set 'outputs=[\"{stage}\"]' asks for them"
    if waiting:
        command = proposed("run", run, selection=selection)
        return f"none made yet ({counted(waiting, 'shape')} without); {command} makes them, or says why not"
    plan = run.plan(selection)
    chosen, named = selection.targets(run.shapes), run.config.file.shots.ids
    classes = sorted({shape.category for shape in run.shapes if shape.name in chosen})
    told = {category: why for category in classes if (why := plan.no_shots(category))}
    if plan.unannotated:
        return f"none: no shape is annotated{remedy(run) or '; ask for stages that need no annotations'}"
    if told:
        more = f" (and {len(told) - 1} more)" if len(told) > 1 else ""
        return f"none: {next(iter(told.values()))}{more}{'' if next(iter(told)) in named else remedy(run)}"
    return "none: what is selected are shots, which predictions are made from; select others"


def _annotating_helps(run: Run, plan: Plan) -> bool:
    """Whether shots are lacking which could be clicked, and which no line of the run has proposed to click yet."""
    dataset, named = run.config.dataset, run.config.file.shots.ids
    if dataset.annotations_kept():
        return False
    if plan.unannotated:
        return bool(dataset.unannotated())  # else there are some that cannot be read
    return any(draw.error and draw.category not in named for draw in plan.draws)
