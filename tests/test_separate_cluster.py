"""--scheduler: real, separately started schedulers and workers, which come, go, and may want certificates."""

from __future__ import annotations

import shutil
import socket
import subprocess
from pathlib import Path

import pytest

from b23d.pipeline.errors import ClusterError, RunFileError
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.tasks import Outcome, Task
from tests.separate_cluster import SeparateCluster, separate_cluster
from tests.toy import make_toy

TLS = '[execution.tls]\nca = "ca.pem"\ncert = "cert.pem"\nkey = "cert.key"\n'
SLOW = "[stages.square]\npause = 0.1\n"


def unused_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{probe.getsockname()[1]}"


def load(path: Path, *overrides: str) -> Run:
    return Run.load(path, ["execution.timeout=30", *overrides])


def test_a_scheduler_that_is_not_there_is_said_after_the_time_out(tmp_path: Path) -> None:
    address = unused_address()
    run = Run.load(make_toy(tmp_path), ["execution.timeout=1"])
    with pytest.raises(ClusterError, match=rf"scheduler {address}: expected it to answer within 1 s") as caught:
        run.execute(scheduler=address)
    assert caught.value.exit_code == 4
    assert run.execute(workers=0).ok


def test_a_scheduler_without_workers_is_said_after_the_time_out(tmp_path: Path) -> None:
    with separate_cluster(tmp_path, workers=0) as cluster:
        run = Run.load(make_toy(tmp_path), ["execution.timeout=1"])
        with pytest.raises(ClusterError, match="expected a worker within 1 s, got none"):
            run.execute(scheduler=cluster.address)


@pytest.mark.parametrize(("victim", "after"), [("scheduler", 10), ("workers", 10)])
def test_what_dies_in_mid_run_is_named_and_nothing_done_is_lost(tmp_path: Path, victim: str, after: int) -> None:
    path = make_toy(tmp_path, extra=SLOW)
    with separate_cluster(tmp_path) as cluster:

        def kill(_: Plan, what: Outcome | Task) -> None:
            if isinstance(what, Task):
                return
            for process in [cluster.scheduler] if victim == "scheduler" else cluster.workers:
                process.kill()

        with pytest.raises(ClusterError, match="is gone" if victim == "scheduler" else "all are gone"):
            load(path, f"execution.timeout={after}").execute(scheduler=cluster.address, watch=kill)
    done = load(path).plan().count()["square"][State.CACHED]
    assert 1 <= done < 6
    again = load(path).execute(workers=0)
    assert again.ok and len([o for o in again.done if o.stage == "square"]) == 6 - done


def test_one_worker_dies_another_comes_and_the_run_is_whole(tmp_path: Path) -> None:
    path = make_toy(tmp_path, extra=SLOW)
    with separate_cluster(tmp_path, workers=2) as cluster:
        seen: list[Outcome | Task] = []

        def replace(_: Plan, what: Outcome | Task) -> None:
            seen.append(what)
            if len([each for each in seen if isinstance(each, Outcome)]) == 2:
                cluster.workers[0].kill()
                cluster.add_worker()

        report = load(path).execute(scheduler=cluster.address, watch=replace)
    assert report.ok and len(report.done) == 20


def test_a_stage_that_needs_a_gpu_runs_where_there_is_one(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    with separate_cluster(tmp_path, workers=1) as cluster:
        cluster.add_worker("--resources", "gpu=1", "--name", "card")
        report = load(path, 'outputs=["needs_gpu", "shift"]').execute(scheduler=cluster.address)
    assert report.ok and {o.stage for o in report.done} == {"needs_gpu", "square", "shift"}


def certificates(folder: Path) -> tuple[str, str, str]:
    """(authority, certificate, key), made with openssl for 127.0.0.1."""
    if shutil.which("openssl") is None:
        pytest.skip("needs the openssl program: apt-get install openssl")
    ca, ca_key, cert, key = (str(folder / name) for name in ("ca.pem", "ca.key", "cert.pem", "cert.key"))
    request, extra = str(folder / "request.pem"), folder / "extra"
    extra.write_text("subjectAltName=IP:127.0.0.1\n")
    new = ("openssl", "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    sign = ("openssl", "x509", "-req", "-in", request, "-CA", ca, "-CAkey", ca_key, "-CAcreateserial", "-days", "2")
    for command in (
        (*new, "-x509", "-days", "2", "-subj", "/CN=test authority", "-keyout", ca_key, "-out", ca),
        (*new, "-subj", "/CN=127.0.0.1", "-keyout", key, "-out", request),
        (*sign, "-extfile", str(extra), "-out", cert),
    ):
        subprocess.run(command, check=True, capture_output=True)
    return ca, cert, key


def test_tls_with_certificates_from_the_run_file(tmp_path: Path) -> None:
    """Paths are relative to the run file; whoever has no certificate is not let in."""
    ca, cert, key = certificates(tmp_path)
    tls = ("--tls-ca-file", ca, "--tls-cert", cert, "--tls-key", key)
    path = make_toy(tmp_path, extra=TLS)
    with separate_cluster(tmp_path, tls=tls) as cluster:
        assert cluster.address.startswith("tls://")
        (bare := tmp_path / "bare").mkdir()
        with pytest.raises(RunFileError, match="expected certificates for tls, got none"):
            load(make_toy(bare)).execute(scheduler=cluster.address)
        certificates(bare)
        stranger = load(make_toy(bare, extra=TLS), "execution.timeout=2")
        with pytest.raises(ClusterError, match="expected it to answer within 2 s"):
            stranger.execute(scheduler=cluster.address)
        report = load(path).execute(scheduler=cluster.address)
    assert report.ok and len(report.done) == 20
    with pytest.raises(FileNotFoundError, match=r"execution\.tls\.ca: expected a PEM file"):
        load(make_toy(bare), 'execution.tls={ca="nowhere.pem", cert="cert.pem"}').execute(scheduler="tls://127.0.0.1:9")


def test_the_cluster_ends_with_its_test(tmp_path: Path) -> None:
    cluster = SeparateCluster(tmp_path)
    cluster.close()
    assert cluster.scheduler.poll() is not None
