"""Limits of the address space: a one-line error, for any failure of the libraries under such a limit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click
import pytest

from avs3d_bench.cli import run
from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime import memory_limit
from tests.evaluators.test_score import submit, true_mask
from tests.support import tiny

resource = pytest.importorskip("resource", reason="the system has no limits of the address space")
PROGRAMS = {
    "avs3d": "from avs3d_bench.cli import main; main()",
    "avs3d-eval": "from evaluators.cli import main; main()",
}


def call(program: str, limit_kb: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    code = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({limit_kb * 1024},) * 2); {PROGRAMS[program]}"
    words = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("limit", [200_000, 300_000, 600_000])
def test_too_little_is_one_line(tmp_path: Path, program: str, limit: int):
    words = ["check"] if program == "avs3d" else []
    done = call(program, limit, *words, tmp_path, "--dataset", tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        f"{program}: error: the address space of this process is limited to {limit // 1024} MB (ulimit -v {limit}), "
        "expected at least 900 MB; raise the limit (ulimit -v unlimited)\n"
    )


def test_help_needs_little():
    assert "Commands:" in call("avs3d", 200_000, "--help").stdout


@pytest.mark.slow
def test_a_million_kilobytes_are_enough_to_score(tmp_path: Path):
    data = tiny.write_dataset(tmp_path / "tiny", frames=9)
    submission = submit(tmp_path / "s", data, true_mask)
    done = call("avs3d-eval", 1_000_000, submission, "--dataset", data, "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert "overall (2)" in done.stdout


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        MemoryError("Unable to allocate 4.00 GiB\nfor an array"),
        ImportError("libgfortran.so.5: failed to map segment from shared object"),
        ImportError("libfoo.so: cannot allocate memory in static TLS block"),
    ],
)
def test_what_memory_has_caused_is_one_line(error: Exception, capsys: pytest.CaptureFixture[str]):
    @click.command()
    def command() -> None:
        raise error

    with pytest.raises(SystemExit) as end:
        run(command, [])
    said = capsys.readouterr().err
    assert end.value.code == 1
    assert said.startswith("avs3d: error: out of memory")
    assert said.count("\n") == 1


def test_other_errors_of_imports_are_bugs():
    @click.command()
    def command() -> None:
        raise ImportError("cannot import name 'x' from 'y'")

    with pytest.raises(ImportError, match="cannot import name"):
        run(command, [])


def test_numpy_gets_one_thread_where_there_is_not_much(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    for limit, threads in ((resource.RLIM_INFINITY, None), (2**40, None), (2**30, "1")):
        monkeypatch.setattr(resource, "getrlimit", lambda _, limit=limit: (limit, limit))
        memory_limit.check_address_space(["x"])
        assert memory_limit.os.environ.get("OPENBLAS_NUM_THREADS") == threads
    monkeypatch.setattr(resource, "getrlimit", lambda _: (2**20, 2**20))
    memory_limit.check_address_space(["--help"])
    with pytest.raises(Avs3dError, match="limited to 1 MB"):
        memory_limit.check_address_space(["x"])
