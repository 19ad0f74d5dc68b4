"""From a run file and overrides to checked params: closed schemas, dotted overrides, paths made absolute."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from b23d.pipeline.dataset import DATASETS, Dataset
from b23d.pipeline.errors import RunFileError
from b23d.pipeline.runfile.anchoring import Anchored, anchor, place_store, table_in, tables_in
from b23d.pipeline.runfile.checking import Where, short, suggest, validate
from b23d.pipeline.runfile.overrides import Carried, put, unused
from b23d.pipeline.runfile.plugins import Plugin
from b23d.pipeline.stage import Stage, default_outputs, load_stages
from b23d.schemas.artifact import Artifact
from b23d.schemas.params import Params, tables_of
from b23d.schemas.runfile import RunFile, Tls


@dataclass(frozen=True)
class Config:
    """Everything a run file says, checked."""

    path: Path
    overrides: tuple[str, ...]
    file: RunFile
    dataset: Dataset
    stages: dict[str, Stage]
    """The stages the run's outputs need, in dataflow order."""
    params: dict[str, Params]
    plugins: tuple[Plugin, ...] = ()
    """The user's own modules; loaded here, and in every worker."""


def load_config(path: str | Path, overrides: Iterable[str] = ()) -> Config:
    """Read `path` (TOML), apply `a.b=value` overrides, check every table.

    A run file may hold options of methods that are not chosen; an override of one is an error, but if `Carried`.
    Raises FileNotFoundError, or RunFileError naming the key, what was expected and what to do.
    """
    path, overrides = Path(path), tuple(overrides)
    tables = _read(path)
    for text in overrides:
        put(tables, text)
    plugins = _plugins(tables)
    for plugin in plugins:
        plugin.load()
    installed, place = load_stages(), Where(path, "", overrides)
    tls = table_in(table_in(tables, "execution"), "tls")
    tls.update(_absolute(Tls, tls, place.table("execution.tls")))
    store = place.table("store")
    said = store.of("root")
    place_store(tables, path, f"{said} root" if said == str(store) else said)
    if "outputs" not in tables:
        tables["outputs"] = default_outputs()
    file = validate(RunFile, tables, place, {f"stages.{name}": stage.params for name, stage in installed.items()})
    dataset = _dataset(file, place)
    stages = _needed(file, installed, dataset.lacks(), place)
    for name in file.stages:
        if name not in installed:
            where = place.of(f"stages.{name}")
            raise RunFileError(f"{where}: expected a stage, got {short(name)}; {suggest(name, installed)}")
    every = {name: _params(installed, name, file, place) for name in {**stages, **file.stages}}
    params = {name: every[name] for name in stages}  # tables of the others are checked as well
    for text in overrides:
        if not isinstance(text, Carried) and (reason := unused(text, every)):
            raise RunFileError(reason)
    for name in file.store.transient:
        if name not in installed:
            where = place.of("store.transient")
            raise RunFileError(
                f"{where}: expected store.transient to name stages, got {short(name)}; {suggest(name, installed)}"
            )
    return Config(path, overrides, file, dataset, stages, params, plugins)


def refuse_unused(overrides: Iterable[str], configs: Sequence[Config]) -> None:
    """Raises RunFileError where one of the overrides counts in none of a series of runs."""
    for text in overrides:
        reasons = [unused(text, config.params) for config in configs]
        if reasons and all(reasons):
            raise RunFileError(str(reasons[0]))


def feeding(file: RunFile, upstream: str) -> str:
    """The stage that feeds arguments called `upstream`, by the run's `[feeds]`."""
    return file.feeds.get(upstream, upstream)


def gates(stages: Mapping[str, Stage], leaf: str, schema: type[Artifact]) -> list[str]:
    """The stages that check a leaf of this schema."""
    return [
        name
        for name, stage in stages.items()
        if stage.checks == leaf and any(item.upstream == leaf and item.schema is schema for item in stage.inputs)
    ]


def needed_for(config: Config, stage: str) -> set[str]:
    """A stage of the run and all stages that it needs."""
    found: set[str] = set()
    waiting = [stage]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            for item in config.stages[name].inputs:
                source = feeding(config.file, item.upstream)
                waiting += [source] if source in config.stages else gates(config.stages, source, item.schema)
    return found


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    if path.resolve() in seen:
        raise RunFileError(f"run file {path}: expected `base` to end somewhere, got a circle; remove one `base`")
    try:
        tables = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except FileNotFoundError as error:
        reason = f"run file: expected a TOML file, got nothing at {path}; give the path of one, e.g. runs/demo.toml"
        raise FileNotFoundError(reason) from error
    except OSError as error:
        raise RunFileError(f"run file {path}: expected a file to read, got {error.strerror}; check it") from error
    except UnicodeDecodeError as error:
        raise RunFileError(f"run file {path}: expected text in UTF-8, got {error}; save it so") from error
    except RecursionError as error:
        raise RunFileError(f"run file {path}: expected TOML, got lists or tables nested too deep; mend it") from error
    except ValueError as error:  # tomllib's own, and Python's for numbers of thousands of digits
        raise RunFileError(
            f"run file {path}: expected TOML, got a syntax error: {error}; mend the line it names"
        ) from error
    for table in [
        table_in(tables, "dataset"),
        table_in(tables, "store"),
        table_in(table_in(tables, "execution"), "tls"),
        *tables_in(tables.get("stages")),
    ]:
        if isinstance(table, dict):
            anchor(table, path.parent)
    own = table_in(tables, "plugins").get("modules")
    if isinstance(own, list):
        own[:] = [str(path.parent / module) if isinstance(module, str) else module for module in own]
    base = tables.pop("base", None)
    if base is None:
        return tables
    if not isinstance(base, str) or "\0" in base:
        raise RunFileError(f"run file {path}: expected base to be another run file, got {short(base)}; mend the value")
    merged = _read(path.parent / base, (*seen, path.resolve()))
    dataset, inherited = tables.get("dataset", {}), merged.get("dataset", {})
    both = isinstance(dataset, dict) and isinstance(inherited, dict)
    if both and inherited and dataset.get("kind") not in (None, inherited.get("kind")):
        merged.pop("dataset")  # another kind of data set shares no fields with the base's
    _merge(merged, tables)
    return merged


def _plugins(tables: Mapping[str, Any]) -> tuple[Plugin, ...]:
    """The modules that the run file names; what is no list of names is refused when all is validated."""
    modules = table_in(tables, "plugins").get("modules")
    if not isinstance(modules, list):
        return ()
    return tuple(Plugin.read(Path(module).resolve()) for module in modules if isinstance(module, str))


def _merge(into: dict[str, Any], tables: Mapping[str, Any]) -> None:
    for key, value in tables.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = value


def _dataset(file: RunFile, place: Where) -> Dataset:
    kind = file.dataset.get("kind")
    if not isinstance(kind, str) or kind not in DATASETS:
        known = ", ".join(sorted(DATASETS))
        raise RunFileError(
            f"{place.of('dataset.kind')}: expected dataset.kind to be one of {known}, got {short(kind)}; "
            f"{suggest(str(kind), DATASETS)}"
        )
    where = place.table("dataset")
    return validate(DATASETS[kind], _absolute(DATASETS[kind], file.dataset, where), where)


def _params(installed: Mapping[str, Stage], name: str, file: RunFile, place: Where) -> Params:
    where, stage = place.table(f"stages.{name}"), installed[name]
    feeders = [feeding(file, item.upstream) for item in stage.inputs]
    fed = [other for other in installed if name in (feeding(file, item.upstream) for item in installed[other].inputs)]
    near = {f"stages.{other}": installed[other].params for other in [*fed, *feeders] if other in installed}
    return validate(stage.params, _absolute(stage.params, file.stages.get(name, {}), where), where, near)


def _absolute(model: type[Params], table: Mapping[str, Any], where: Where) -> dict[str, Any]:
    """The table with its Path fields absolute: relative to the file they stand in, or to the current folder if
    overridden."""

    def resolve(key: str, value: Any) -> Any:
        if key in (tables := tables_of(model)) and isinstance(value, dict):
            return _absolute(tables[key], value, where.table(f"{where.name}.{key}"))
        field = model.model_fields.get(key)
        if field is None or Path not in (field.annotation, *get_args(field.annotation)) or not isinstance(value, str):
            return str(value) if isinstance(value, Anchored) else value
        folder = value.folder if isinstance(value, Anchored) else Path.cwd()
        try:
            return (folder / Path(value).expanduser()).resolve()
        except (OSError, ValueError, RuntimeError) as error:  # a null byte, the home of nobody, links in a circle
            raise RunFileError(f"{where.of(key)}: expected {key} to be a path, got {short(value)}; {error}") from error

    return {key: resolve(key, value) for key, value in table.items()}


def _needed(file: RunFile, installed: Mapping[str, Stage], lacks: set[str], place: Where) -> dict[str, Stage]:
    """Stages the outputs need, upstream first; none that wants a leaf of `lacks`."""
    order: dict[str, Stage] = {}

    def visit(name: str, trail: tuple[str, ...]) -> None:
        if name in order:
            return
        if name in trail:
            circle = " → ".join([*trail, name])
            raise RunFileError(
                f"{place.of('feeds')}: feeds: expected a flow without circles, got {circle}; change [feeds]"
            )
        for item in installed[name].inputs:
            source = feeding(file, item.upstream)
            if item.optional and source in installed and lacks & {i.upstream for i in installed[source].inputs}:
                continue
            if source not in installed:
                if item.upstream in file.feeds:
                    key = f"feeds.{item.upstream}"
                    told = f"expected a stage, got {short(source)}; {suggest(source, installed)}"
                    raise RunFileError(f"{place.of(key)}: {key}: {told}")
                for gate in gates(installed, source, item.schema):
                    if gate != name and not item.example:
                        visit(gate, (*trail, name))
                continue
            if not issubclass(installed[source].gives, item.schema):
                told = f"{item.name} to be {item.schema.__name__}, got {installed[source].gives.__name__} from {source}"
                raise RunFileError(
                    f"{place.of(f'feeds.{item.upstream}')}: stage {name}: expected {told}; change [feeds]"
                )
            visit(source, (*trail, name))
        order[name] = installed[name]

    for output in file.outputs:
        source = feeding(file, output)
        if source not in installed:
            told = f"expected a stage, got {short(source)}; {suggest(source, installed)}"
            raise RunFileError(f"{place.of('outputs')}: outputs: {told}")
        visit(source, ())
    return order
