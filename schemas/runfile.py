"""RunFile: what a run is. TOML, closed; every table is checked in full before anything runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from b23d.schemas.params import Params


class Shots(Params):
    """Which annotated shapes are the few shots. A draw takes, per class, the `count` shapes that rank first under
    sha256(draw, shape); so a new shape changes a draw only if it is drawn itself."""

    count: int = Field(3, ge=1)
    draws: list[int] = [0, 1, 2, 3, 4]
    """One seeded draw of shots each; scores give mean and sd over draws."""
    ids: dict[str, list[str]] = {}
    """Class → ids of its shots, instead of drawing: for people who annotated a few shapes themselves."""
    split: Literal["all-but-shots", "official"] = "all-but-shots"
    """Targets: every shape that is not a shot of the draw, or the data set's own test split (shots then come from
    train)."""


class StoreOptions(Params):
    root: str = ".store"
    """Folder (relative to the run file that says so; given with --set, to the current folder) or fsspec URL."""
    transient: list[str] = []
    """Stages that are never stored; their consumers run them inline."""


class Resources(Params):
    """What one task of a stage occupies; dask resources on workers that declare them."""

    gpu: float = 0


class Tls(Params):
    """Certificates (PEM files) for a cluster whose address begins with tls://."""

    ca: Path
    """Whom to trust: the authority that signed the scheduler's and the workers' certificates."""
    cert: Path
    """This client's certificate."""
    key: Path | None = None
    """Its private key; None: in `cert`."""


class Execution(Params):
    """How to run. Never enters an address."""

    workers: int | None = Field(None, ge=0)
    """Worker processes; 0 runs everything in this process; None: one a core (and `processes_per_gpu` a GPU)."""
    processes_per_gpu: int = Field(4, ge=1)
    """Worker processes that share each GPU: one alone would wait for the host, which renders, reads and writes, most of
    the time. Each loads the encoder: fewer where the card's memory does not hold that many."""
    scheduler: str | None = None
    """Address of an existing dask cluster: tcp://… in a network of friends, tls://… elsewhere."""
    tls: Tls | None = None
    """None: the certificates of dask's own settings (`distributed.comm.tls`)."""
    timeout: float = Field(60.0, gt=0)
    """Seconds to wait for a cluster's scheduler, and for a worker when it has none, before giving up."""
    memory_gb: float = Field(4.0, gt=0)
    """Memory limit of a worker process."""
    resources: dict[str, Resources] = {}
    """Stage → resources it must have, over the stage's own hints."""


class Plugins(Params):
    modules: list[str] = []
    """Python files that declare stages or data sets, relative to the run file; their source travels to the workers."""


class RunFile(Params):
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    base: str | None = None
    """Another run file, relative to this one, whose tables this one extends and overrides."""
    dataset: dict[str, Any]
    """`kind` and that data set's own fields."""
    shots: Shots = Shots()
    stages: dict[str, dict[str, Any]] = {}
    """Stage → its Params; what is absent takes its default."""
    feeds: dict[str, str] = {}
    """Argument → the stage that feeds it instead of its namesake: `backproject = "describe"`, `optimize = "detect"`."""
    plugins: Plugins = Plugins()
    outputs: list[str]
    """Stages wanted for every shape; what they need comes along. Left out: those that the installed stages propose."""
    sweep: dict[str, list[Any]] = {}
    """For `b23d sweep`: dotted field → the values it takes in turn."""
    variants: dict[str, dict[str, Any]] = {}
    """For `b23d sweep` and `b23d analyse`: name of a variant → the dotted fields it sets, run in turn."""
    analysis: dict[str, Any] = {}
    """For `b23d analyse`: `kind` and that analysis's own fields."""
    store: StoreOptions = StoreOptions()
    execution: Execution = Execution()
