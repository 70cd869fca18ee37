"""Programs in forks of the process that has loaded the libraries end, speak and fail as programs of Python do."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support import warm

CODES = {
    "print('said')": (0, "said\n", ""),
    "import sys; sys.exit(3)": (3, "", ""),
    "import sys; sys.exit('wrong')": (1, "", "wrong\n"),
    "raise KeyError('IoU')": (1, "", "KeyError: 'IoU'\n"),
    "import os; os.kill(os.getpid(), 9)": (-9, "", ""),
    "import atexit; atexit.register(print, 'end')": (0, "end\n", ""),
    "print(input(), __name__)": (0, "asked __main__\n", ""),
}


def run(*arguments: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*warm.python(), *arguments], cwd=folder, env=os.environ | environment, input="asked", capture_output=True,
        text=True, check=False, timeout=60,
    )  # fmt: skip


@pytest.mark.parametrize("code", CODES)
def test_a_program_ends_and_speaks_as_it_does_by_itself(code: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(code)
    for arguments in (("-c", code), ("program.py",), ("-m", "program")):
        done = run(*arguments, folder=tmp_path)
        assert (done.returncode, done.stdout, done.stderr.splitlines(True)[-1:]) == (
            *CODES[code][:2], CODES[code][2].splitlines(True),
        )  # fmt: skip


def test_nothing_of_the_project_is_loaded_before(tmp_path: Path) -> None:
    """Else a program would use the project of another folder than its own, or miss what an import lacks."""
    code = "import sys; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = run("-c", code, folder=tmp_path).stdout.split()
    assert "numpy" in loaded
    assert not {"avs3d_bench", "generators", "evaluators", "baselines", "benchmarks", "tests"} & {*loaded}
    (tmp_path / "own/evaluators").mkdir(parents=True)
    (tmp_path / "own/evaluators/__init__.py").write_text("print('of my own')")
    assert run("-c", "import evaluators", folder=tmp_path, PYTHONPATH="own").stdout == "of my own\n"


def test_arguments_folders_and_variables_are_those_of_the_caller(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text("import os, sys; print(sys.argv, os.environ['NAME'], os.getcwd())")
    said = run("program.py", "--size", "4 m", folder=tmp_path, NAME="value").stdout
    assert said == f"['program.py', '--size', '4 m'] value {tmp_path}\n"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere it is the program itself")
def test_a_program_ends_with_its_client(tmp_path: Path) -> None:
    code = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    with subprocess.Popen([*warm.python(), "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as client:
        assert client.stdout is not None
        process = Path("/proc", client.stdout.readline().strip())
        client.terminate()
    until = time.monotonic() + 20
    while process.exists() and time.monotonic() < until:
        time.sleep(0.01)
    assert not process.exists()
