"""A Dask cluster that requires TLS: a run works with certificates, and ends with a one-line error without them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.avs3d_bench.test_cluster import COMMAND, ROOT, SCHEDULER, WORKER, cluster_of
from tests.support.homes import write_manifest
from tests.support.needs import need

need("distributed", reason="distributed is not installed; it is in the cluster extra")

TLS = ["--protocol", "tls"]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with Dask's configuration as docs/cluster.md has it, and a certificate of its own authority."""
    if shutil.which("openssl") is None:
        pytest.skip("the openssl program, which makes the certificate, is not installed")
    folder = tmp_path_factory.mktemp("dask")
    key, certificate = folder / "key.pem", folder / "cert.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    command += ["-days", "2", "-subj", "/CN=avs3d", "-keyout", str(key), "-out", str(certificate)]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    role = {"cert": str(certificate), "key": str(key)}
    tls = {"ca-file": str(certificate), "scheduler": role, "worker": role, "client": role}
    document = {"distributed": {"comm": {"require-encryption": True, "tls": tls}}}
    (folder / "tls.yaml").write_text(yaml.safe_dump(document))
    return folder


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("manifest"))


def generate(manifest: Path, root: Path, *more: str) -> tuple[int, str]:
    small = ["--only", "part_1/*", "--frames", "2", "--size", "32", "--audio", "analytic", "--scheduler", "dask"]
    command = [*COMMAND, str(manifest), "-o", str(root), *small, *more]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def encrypted(settings: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Processes that are started now find the configuration."""
    monkeypatch.setenv("DASK_CONFIG", str(settings))
    return monkeypatch


def test_a_cluster_with_tls_is_joined_with_certificates_and_not_without(
    encrypted: pytest.MonkeyPatch, manifest: Path, tmp_path: Path
) -> None:
    with cluster_of(tmp_path, [*WORKER, *TLS], scheduler=[*SCHEDULER, *TLS]) as address:
        assert address.startswith("tls://")
        code, output = generate(manifest, tmp_path / "data", "--scheduler-address", address)
        assert code == 0, output
        assert "1 made, 0 kept, 0 failed" in output

        encrypted.delenv("DASK_CONFIG")
        for other in (address, address.replace("tls", "tcp")):
            code, output = generate(manifest, tmp_path / "other", "--scheduler-address", other)
            assert code == 1
            lines = [line for line in output.splitlines() if line.strip()]
            assert len(lines) == 1, output
            assert lines[0].startswith(f"avs3d: error: --scheduler-address {other}: no Dask scheduler answers there")
        assert not list((tmp_path / "other").glob("part_*"))


QUEUE = """
from pathlib import Path
from avs3d_bench.scheduling.jobqueue import make_cluster
import distributed
cluster = make_cluster("slurm", {"cores": 1, "memory": "1GB", "interface": "lo"}, Path("options.yaml"))
print(cluster.job_script())
with distributed.Client(cluster, timeout=20) as client:
    print("client at", client.scheduler.address)
cluster.close(timeout=5)
"""


LOCAL = """
from avs3d_bench.scheduling.dask_backend import DaskScheduler
if __name__ == "__main__":
    with DaskScheduler(1) as scheduler:
        client = scheduler._client
        print("client at", client.scheduler.address, "answer", client.submit(sum, [1, 2, 3]).result(timeout=60))
        print("worker at", *client.nthreads())
"""


def run_script(text: str, folder: Path) -> str:
    (folder / "script.py").write_text(text)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_workers_of_this_machine_speak_tls_where_the_configuration_says_so(
    encrypted: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    said = run_script(LOCAL, tmp_path)
    assert "client at tls://127.0.0.1:" in said
    assert "answer 6" in said
    assert "worker at tls://127.0.0.1:" in said


def test_jobs_of_a_queue_are_told_to_speak_tls(encrypted: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed; it is in the cluster extra")
    said = run_script(QUEUE, tmp_path)
    assert "dask_worker tls://127.0.0.1:" in said
    assert "--protocol tls://" in said
    assert "client at tls://127.0.0.1:" in said
