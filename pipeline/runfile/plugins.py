"""Stages and data sets in a file of the user's own: `[plugins] modules = ["my_stage.py"]` in the run file.

A module's source travels to the workers, so that a cluster needs no copy of the file. It is one file: it may import
what is installed, but not its neighbours.
"""

from __future__ import annotations

import hashlib
import linecache
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from b23d.pipeline.dataset import DATASETS
from b23d.pipeline.errors import RunFileError, reason
from b23d.pipeline.stage import STAGES

PREFIX = "b23d_plugin_"


@dataclass(frozen=True)
class Plugin:
    """One module, small and picklable."""

    path: str
    """Where it was read, for messages and tracebacks."""
    source: str

    @classmethod
    def read(cls, path: Path) -> Plugin:
        """Raises RunFileError where there is no such Python file."""
        if path.suffix != ".py":
            raise RunFileError(f"plugins.modules: expected Python files, got {path.name}; name a file with .py")
        try:
            return cls(str(path), path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise RunFileError(
                f"plugins.modules: expected a Python file {path}, got {reason(error)}; check the path"
            ) from error

    @property
    def module(self) -> str:
        """The module's name: another for every content, the same in every process."""
        content = "\n".join([self.path, self.source]).encode()
        return f"{PREFIX}{hashlib.sha256(content).hexdigest()[:16]}"

    def load(self) -> None:
        """Import it, if that has not been done. What an older content of the file has declared is forgotten.

        Raises RunFileError where the module raises.
        """
        if self.module in sys.modules:
            return
        _forget(self.path)
        module = ModuleType(self.module)
        module.__file__ = self.path
        sys.modules[self.module] = module
        linecache.cache[self.path] = (len(self.source), None, self.source.splitlines(True), self.path)
        try:
            exec(compile(self.source, self.path, "exec"), module.__dict__)
        except Exception as error:
            del sys.modules[self.module]
            _forget(self.path, self.module)
            line = error.lineno if isinstance(error, SyntaxError) else _line(error, self.path)
            at = f"{self.path}:{line}" if line else self.path
            raise RunFileError(f"plugins: {at}: {type(error).__name__}: {error}; mend the module") from error


def _forget(path: str, module: str | None = None) -> None:
    """Drop the declarations of the modules that were read from `path`, or of one module alone."""
    old = {name for name, m in sys.modules.items() if name.startswith(PREFIX) and getattr(m, "__file__", None) == path}
    old |= {module} if module is not None else set()
    for stage in [name for name, stage in STAGES.items() if stage.function.__module__ in old]:
        del STAGES[stage]
    for kind in [kind for kind, declared in DATASETS.items() if declared.__module__ in old]:
        del DATASETS[kind]


def _line(error: BaseException, path: str) -> int | None:
    """The last line of the file that the error passed through."""
    found, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == path:
            found = trace.tb_lineno
        trace = trace.tb_next
    return found
