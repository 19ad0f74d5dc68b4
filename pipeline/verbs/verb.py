"""A verb of the command line: its help is shown as it is written."""

from __future__ import annotations

from typing import Any

from rich.markup import escape
from typer.core import TyperCommand


class Verb(TyperCommand):
    """Help texts are plain: `[sweep]` in one is a table of a run file, not a style to print in."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        for told in (self, *self.params):
            text = getattr(told, "help", None)
            if isinstance(text, str):
                setattr(told, "help", escape(text))  # noqa: B010  # a bare parameter has none, so mypy knows of none
