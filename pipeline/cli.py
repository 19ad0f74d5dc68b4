"""The command line. Verbs that know 3D (scores, report, …) are plugged in by the entry-point group `b23d.commands`."""

from __future__ import annotations

import sys
from importlib.metadata import entry_points
from importlib.metadata import version as installed
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from b23d.pipeline.errors import B23dError, told
from b23d.pipeline.scheduling.stopping import Stopped, end, stop_on_signals
from b23d.pipeline.verbs.accept import accept
from b23d.pipeline.verbs.explain import explain
from b23d.pipeline.verbs.gc import gc
from b23d.pipeline.verbs.listing import list_
from b23d.pipeline.verbs.log import log
from b23d.pipeline.verbs.params import params
from b23d.pipeline.verbs.plan import plan
from b23d.pipeline.verbs.run import run
from b23d.pipeline.verbs.show import show
from b23d.pipeline.verbs.status import status
from b23d.pipeline.verbs.terminal import debug as debugging
from b23d.pipeline.verbs.trying import try_
from b23d.pipeline.verbs.verb import Verb
from b23d.pipeline.verbs.verify import verify

app = typer.Typer(
    name="b23d",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Few-shot 3D keypoints and back-projected 2D features for whole data sets.",
)
for verb in (run, plan, list_, show, explain, try_, accept, log, status, verify, gc, params):
    app.command(verb.__name__.rstrip("_"), cls=Verb)(verb)


def _version(asked: bool) -> None:
    if asked:
        print(f"b23d {installed('b23d')}")
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Say which b23d this is.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    debugging.on = debug


def plug_in() -> None:
    """Add the commands of the entry-point group `b23d.commands`."""
    known = {command.name for command in app.registered_commands}
    for plugin in sorted(entry_points(group="b23d.commands"), key=lambda plugin: plugin.name):
        if plugin.name not in known:
            app.command(plugin.name, cls=Verb)(plugin.load())


def main(arguments: list[str] | None = None) -> None:
    """Entry point of `b23d`: errors are printed as one line, without a traceback."""
    stop_on_signals()
    try:
        plug_in()
        app(args=arguments)
    except Stopped as stop:
        print(stop, file=sys.stderr)
        end(stop.code)
    except (B23dError, OSError, ValueError, KeyError, RuntimeError) as error:
        if debugging.on:
            raise
        Console(stderr=True).print(f"[red]error:[/] {escape(told(error))}", highlight=False, soft_wrap=True)
        sys.exit(error.exit_code if isinstance(error, B23dError) else 2)


if __name__ == "__main__":
    main()
