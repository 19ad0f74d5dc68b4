"""Overrides, `a.b=value`: what they set, and whether it counts."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from b23d.pipeline.errors import RunFileError
from b23d.schemas.params import Params, flat, missing_choice
from b23d.schemas.wording import bare

SHOWN = 120  # characters of an override, or of a value, that a message shows


class Carried(str):
    """An override that may set options of choices not taken, as a run file may: it goes through a whole series of
    runs."""


class Listed(str):
    """An override that a run file itself lists, in `[sweep]` or `[variants]`: what is wrong is said of there."""

    where: str

    def __new__(cls, text: str, where: str = "run file") -> Listed:
        self = super().__new__(cls, text)
        self.where = where
        return self


def said(text: str) -> str:
    """An override as a message names it: by where it was said."""
    cut = text if len(text) <= SHOWN else f"{text[:SHOWN]}…"
    return f"{text.where}: {cut}" if isinstance(text, Listed) else f"--set {cut}"


def parsed(text: str) -> tuple[list[str], Any]:
    """Names from the top table down, and the value. Raises RunFileError where it is no `a.b=value`."""
    if not isinstance(text, str):
        raise RunFileError(
            f"overrides: expected texts like 'a.b=value', got {text!r}; for example overrides=['shots.count=5']"
        )
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        where, how = (text.where, "") if isinstance(text, Listed) else ("--set", "--set ")
        raise RunFileError(f"{where}: expected a.b=value, got {text!r}; for example {how}shots.count=5")
    return name.strip().split("."), _value(value.strip())


def put(tables: dict[str, Any], text: str) -> None:
    """Set the field that an override sets. Raises RunFileError where what it should stand in is no table."""
    keys, value = parsed(text)
    for key in keys[:-1]:
        inner = tables.setdefault(key, {})
        if not isinstance(inner, dict):
            raise RunFileError(f"{said(text)}: expected {key} to be a table, got {inner!r}; check the name")
        tables = inner
    tables[keys[-1]] = value


def unused(text: str, params: Mapping[str, Params]) -> str | None:
    """Why an override sets an option of a choice not taken; None where what it sets counts."""
    keys, value = parsed(text)
    if keys[0] != "stages":
        return None
    for dotted in flat({".".join(keys): value}):
        stage, *inner = dotted.split(".")[1:] or [""]
        if stage not in params or not inner:
            continue
        if missing := missing_choice(params[stage], inner):
            field, got, wanted = missing
            choice = f"stages.{stage}.{field}={bare(wanted)}"
            how = f"set {choice} there, too" if isinstance(text, Listed) else f"choose that with --set {choice}"
            return (
                f"{said(text)}: expected an option of {field} = {bare(got)}, got one of {field} = {bare(wanted)}; {how}"
            )
    return None


def _value(text: str) -> Any:
    """TOML's value if it is one (2, 0.5, true, "x", ["a", "b"]), JSON's if it is one, else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        pass
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
