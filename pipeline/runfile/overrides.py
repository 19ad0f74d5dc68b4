"""Overrides, `a.b=value`: what they set, and whether it counts."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from b23d.pipeline.errors import RunFileError
from b23d.schemas.params import Params, flat, missing_choice
from b23d.schemas.wording import bare


class Carried(str):
    """An override that may set options of choices not taken, as a run file may: it goes through a whole series of
    runs."""


def parsed(text: str) -> tuple[list[str], Any]:
    """Names from the top table down, and the value. Raises RunFileError where it is no `a.b=value`."""
    if not isinstance(text, str):
        raise RunFileError(
            f"overrides: expected texts like 'a.b=value', got {text!r}; for example overrides=['shots.count=5']"
        )
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise RunFileError(f"--set: expected a.b=value, got {text!r}; for example --set shots.count=5")
    return name.strip().split("."), _value(value.strip())


def put(tables: dict[str, Any], keys: list[str], value: Any) -> None:
    """Set a field. Raises RunFileError where what it should stand in is no table."""
    for key in keys[:-1]:
        inner = tables.setdefault(key, {})
        if not isinstance(inner, dict):
            raise RunFileError(f"--set {'.'.join(keys)}: expected {key} to be a table, got {inner!r}; check the name")
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
            return (
                f"--set {text}: expected an option of {field} = {bare(got)}, got one of {field} = {bare(wanted)}; "
                f"choose that with --set stages.{stage}.{field}={bare(wanted)}"
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
