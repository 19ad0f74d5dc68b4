"""Params by the bare names of their options: each goes into the table of the method that is chosen."""

from __future__ import annotations

from typing import Any, TypeVar

from b23d.schemas.params import Params, homes, tables_of
from b23d.stages.optimize import OptimizeParams
from b23d.stages.solvers.learn_options import LearnParams

P = TypeVar("P", bound=Params)


def placed(model: type[P], **options: Any) -> P:
    """`placed(OptimizeParams, method="discrete", alpha=1)` is `OptimizeParams(method="discrete", discrete={"alpha":
    1})`; what the choice taken has not goes into the tables that have it. Raises TypeError where none has."""
    own = {key: value for key, value in options.items() if key in model.model_fields and key not in tables_of(model)}
    chosen, tables = model(**own), dict[str, Any](own)
    for key in options.keys() - own.keys():
        found = homes(model, key)
        if not found:
            raise TypeError(f"{model.__name__}: no option {key}")
        for home in [home for home in found if chosen.counts(home[0])][:1] or found:
            table = tables
            for step in home[:-1]:
                table = table.setdefault(step, {})
            table[home[-1]] = options[key]
    return model.model_validate(tables)


def of_learn_and_optimize(**options: Any) -> tuple[LearnParams, OptimizeParams]:
    """Each option goes to the stage that has it."""
    search = {key: value for key, value in options.items() if key in OptimizeParams.model_fields}
    search |= {key: value for key, value in options.items() if homes(OptimizeParams, key)}
    shots = {key: value for key, value in options.items() if key not in search}
    return placed(LearnParams, **shots), placed(OptimizeParams, **search)
