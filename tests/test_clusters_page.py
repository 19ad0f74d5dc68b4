"""runs/clusters.md: its snippets are what they say they are."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml
from distributed import SSHCluster

from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.cluster import ENVIRON
from b23d.schemas.runfile import Execution, StoreOptions

PAGE = (Path(__file__).parents[1] / "runs" / "clusters.md").read_text()
SNIPPETS = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def of(language: str) -> list[str]:
    return [text for kind, text in SNIPPETS if kind == language]


def test_the_run_file_is_one() -> None:
    (text,) = of("toml")
    tables = tomllib.loads(text)
    assert Execution(**tables["execution"]).tls is not None and StoreOptions(**tables["store"]).root.startswith("s3://")


@pytest.mark.parametrize("text", of("python"))
def test_the_python_calls_what_there_is(text: str) -> None:
    tree = ast.parse(text)
    calls = {
        call.func.attr if isinstance(call.func, ast.Attribute) else call.func.id: call
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute | ast.Name)
    }
    inspect.signature(Run.execute).bind(None, **{word.arg: None for word in calls["execute"].keywords if word.arg})
    if "SSHCluster" in calls:
        inspect.signature(SSHCluster).bind(None, **{w.arg: None for w in calls["SSHCluster"].keywords if w.arg})
    guard = [node for node in tree.body if isinstance(node, ast.If)]
    assert guard and ast.unparse(guard[0].test) == "__name__ == '__main__'", "workers import the script"


def test_the_manifest_is_a_dask_cluster() -> None:
    (text,) = of("yaml")
    manifest = yaml.safe_load(text)
    assert manifest["kind"] == "DaskCluster"
    for role in ("worker", "scheduler"):
        (container,) = manifest["spec"][role]["spec"]["containers"]
        assert container["args"][:2] == ["dask", role]
    assert manifest["spec"]["scheduler"]["service"]["type"] == "ClusterIP", "never open to the world"


@pytest.mark.parametrize("text", of("sh"))
def test_the_shell_parses_and_its_options_exist(text: str) -> None:
    subprocess.run(["bash", "-n"], input=text, text=True, check=True)
    for line in text.splitlines():
        if found := re.search(r"dask (scheduler|worker) (.*)", line):
            done = subprocess.run(["python", "-m", "dask", found[1], "--help"], capture_output=True, text=True)
            if done.returncode == 0:
                assert all(option in done.stdout for option in re.findall(r"--[\w-]+", found[2])), line
    for name, value in re.findall(r"(\w+)=(\d+)", "".join(re.findall(r"^export (.*)$", text, re.MULTILINE))):
        assert ENVIRON[name] == value
