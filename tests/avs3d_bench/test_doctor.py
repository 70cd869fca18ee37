"""`avs3d doctor`: it reports installed and missing parts, and fails for neither."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

import pytest

from avs3d_bench.runtime import doctor
from avs3d_bench.runtime.doctor import Check, CheckResult, all_checks, constant, examine, package_check, run_in_turn

VARIABLES = (
    "AVS3D_HABITAT_PYTHON",
    "AVS3D_SCANS",
    "AVS3D_CHECKPOINTS",
    "AVS3D_SH3F",
    "SKETCHFAB_TOKEN",
    "FREESOUND_TOKEN",
)


@pytest.fixture(autouse=True)
def _no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


def found(findings: tuple[CheckResult, ...], name: str) -> CheckResult:
    return next(finding for finding in findings if finding.name == name)


def shell(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "avs3d_bench", "doctor", *arguments],
        capture_output=True, text=True, timeout=300, env={**os.environ, **environment},
    )  # fmt: skip


# Checks


def test_a_package_that_works_is_shown_with_its_version_and_what_it_said():
    check = package_check("core", "numpy", "numpy", "pip install numpy", program="print('first'); print('4 = 2 + 2')")
    (finding,) = check.run()
    assert finding.state == "ok"
    assert finding.found.endswith(", 4 = 2 + 2")
    assert finding.fix == ""


@pytest.mark.parametrize(
    ("program", "expected", "limit"),
    [
        ("import os; os.kill(os.getpid(), 11)", "ended by signal 11", 60),
        ("raise RuntimeError('no device')", "RuntimeError: no device", 60),
        ("import sys; print('EGL is missing', file=sys.stderr); sys.exit(3)", "EGL is missing", 60),
        ("import time; time.sleep(60)", "did not answer within 1 s", 1),
    ],
)
def test_an_engine_that_crashes_raises_or_hangs_is_broken(program: str, expected: str, limit: float):
    started = time.monotonic()
    (finding,) = package_check("x", "numpy", "numpy", "pip install numpy", program=program, limit=limit).run()
    assert finding.state == "broken"
    assert expected in finding.found
    assert finding.fix == "pip install numpy --force-reinstall"
    assert time.monotonic() - started < 30


def test_versions_that_differ_from_the_tested_set_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TESTED_VERSIONS", tmp_path / "tested.txt")
    check = next(check for check in doctor.core_checks() if check.name == "versions")
    installed = {name: metadata.version(name) for name in ("numpy", "scipy", "click")}
    lines = ["# a comment", "no-such-package==1.0", *(f"{name}=={version}" for name, version in installed.items())]
    doctor.TESTED_VERSIONS.write_text("\n".join(lines))
    assert check.run() == (CheckResult("core", "versions", "ok", "3 packages as in the tested set"),)
    doctor.TESTED_VERSIONS.write_text("\n".join(lines).replace(f"numpy=={installed['numpy']}", "numpy==1.0.0"))
    (finding,) = check.run()
    assert finding.state == "note"
    assert "1 of 3 packages" in finding.found
    assert f"numpy {installed['numpy']} (1.0.0)" in finding.found
    assert finding.fix == "pip install numpy==1.0.0"


def test_a_check_that_raises_is_a_finding_and_the_others_go_on():
    def bad() -> tuple[CheckResult, ...]:
        raise ValueError("two\nlines")

    findings = examine([Check("a", "first", bad), constant("b", "second", "ok", "there")])
    assert [(f.name, f.state) for f in findings] == [("first", "broken"), ("second", "ok")]
    assert findings[0].found == "ValueError: two lines"


def test_a_bare_machine_has_every_missing_thing_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """As after `pip install avs3d-bench` without extras (has_package is the only way in which checks look)."""
    import baselines.doctor
    import generators.run.doctor

    for module in (doctor, generators.run.doctor, baselines.doctor):
        monkeypatch.setattr(module, "has_package", lambda name: False)
    monkeypatch.setattr(generators.run.doctor, "FURNITURE", tmp_path)
    findings = examine(all_checks())
    missing = {f.name for f in findings if f.state == "missing"}
    assert missing >= {
        "embreex", "numba", "numba-cuda", "trimesh", "xatlas", "rlr-audio-propagation", "habitat-sim", "scans",
        "mitsuba", "Sweet Home 3D", "Sketchfab", "Freesound", "torch", "CUDA", "gsplat", "transformers",
        "scikit-learn", "checkpoints",
    }  # fmt: skip
    assert not [f for f in findings if f.state == "broken"]
    assert all(f.fix for f in findings if f.state == "missing")
    assert {f.name for f in findings if f.state == "ok"} >= {"avs3d-bench"}


# What stands behind the variables


def test_a_habitat_interpreter_that_is_none_is_broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    import generators.run.doctor

    monkeypatch.setenv("AVS3D_HABITAT_PYTHON", str(tmp_path / "nowhere"))
    (finding,) = generators.run.doctor._habitat()
    assert (finding.state, finding.name) == ("broken", "habitat-sim")
    assert "nowhere" in finding.found
    monkeypatch.setenv("AVS3D_HABITAT_PYTHON", sys.executable)  # a Python without habitat_sim
    (finding,) = generators.run.doctor._habitat()
    assert finding.state == "broken"
    assert "habitat_sim" in finding.found
    assert "\n" not in finding.found


def test_the_papers_scans_are_looked_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    import generators.run.doctor

    monkeypatch.setenv("AVS3D_SCANS", str(tmp_path / "gone"))
    assert generators.run.doctor._scans()[0].state == "broken"
    for scan in generators.run.doctor.PAPER_SCANS[:3]:
        (tmp_path / scan).mkdir()
        (tmp_path / scan / f"{scan}.glb").write_bytes(b"glTF")
    monkeypatch.setenv("AVS3D_SCANS", str(tmp_path))
    (finding,) = generators.run.doctor._scans()
    assert finding.state == "note"
    assert finding.found.endswith(f"3 of the 4 scans of 3davs-s34-o7, not {generators.run.doctor.PAPER_SCANS[3]}")
    last = generators.run.doctor.PAPER_SCANS[3]
    (tmp_path / last).mkdir()
    (tmp_path / last / f"{last}.glb").write_bytes(b"glTF")
    assert generators.run.doctor._scans()[0].state == "ok"


def test_free_scans_are_named_whether_they_are_there_or_not(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    import generators.run.doctor
    from generators.library import AssetEntry, Store, update_lock

    data = [b"glTF of a flat", b"glTF of a house"]
    entries = [
        AssetEntry(
            id=f"github/ann/{name}", kind="scan", source="github", ref="x", title=name, author="Ann", licence="CC0-1.0",
            file="scan.glb", sha256=hashlib.sha256(each).hexdigest(), bytes=len(each),
        )
        for name, each in zip(("flat", "house"), data, strict=True)
    ]  # fmt: skip
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    monkeypatch.setattr(generators.run.doctor, "OPEN_LOCK", tmp_path / "assets.lock.yaml")
    update_lock(tmp_path / "assets.lock.yaml", entries)
    states = []
    for entry, each in zip(entries, data, strict=True):
        (finding,) = generators.run.doctor._free_scans()
        states.append(finding.state)
        assert all(f"{one.id} (CC0-1.0)" in finding.found for one in entries)
        assert finding.fix.startswith("avs3d assets fetch --manifest")
        Store.default().put(entry.id, entry.file, each)
    (finding,) = generators.run.doctor._free_scans()
    assert [*states, finding.state] == ["missing", "note", "ok"]


def test_checkpoints_are_looked_for_one_by_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    import baselines.doctor
    from baselines.networks.checkpoints import CHECKPOINTS

    monkeypatch.setenv("AVS3D_CHECKPOINTS", str(tmp_path))
    folder = tmp_path / "sam"
    folder.mkdir()
    for choice in CHECKPOINTS["sam"].files:
        (folder / choice[0]).write_bytes(b"x")
    findings = examine(baselines.doctor._checkpoints())
    assert len(findings) == len(CHECKPOINTS)
    (sam,) = (f for f in findings if f.state == "ok")
    assert (sam.name, sam.found) == ("SAM", f"{folder} (0.0 GB, Apache-2.0, not pinned: no SHA256SUMS)")
    (folder / "SHA256SUMS").write_text("")
    assert found(examine(baselines.doctor._checkpoints()), "SAM").found.endswith("pinned by SHA256SUMS)")
    owl = found(findings, "OWLv2")
    assert owl.state == "missing"
    assert "huggingface.co/google/owlv2" in owl.fix
    (folder / "config.json").write_bytes(b"")
    assert found(examine(baselines.doctor._checkpoints()), "SAM").state == "broken"


# The command


@pytest.mark.slow
def test_the_command_reports_and_exits_with_0(tmp_path: Path):
    done = shell("--json", str(tmp_path / "d.json"), AVS3D_HABITAT_PYTHON=str(tmp_path / "none"))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    document = json.loads((tmp_path / "d.json").read_text())
    findings = {finding["name"]: finding for finding in document["findings"]}
    # The tests need these, so that they must be found to work.
    assert all(findings[name]["state"] == "ok" for name in ("embreex", "numba", "trimesh", "xatlas", "torch"))
    assert findings["habitat-sim"]["state"] == "broken"
    assert "habitat lacks: habitat-sim" in done.stdout
    for finding in findings.values():
        assert finding["fix"] == "" or f"→ {finding['fix']}" in done.stdout


# What the lines advise


def test_a_remark_behind_a_remedy_does_not_swallow_its_option():
    fix = "pip install 'numpy[x]' (needs a compiler), or do without"
    (finding,) = package_check("x", "numpy", "numpy", fix, program="raise SystemExit(1)").run()
    assert (finding.state, finding.fix) == ("broken", fix)


def test_furniture_is_looked_for_where_the_user_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    import generators.run.doctor

    monkeypatch.setattr(generators.run.doctor, "FURNITURE", tmp_path / "debian")
    monkeypatch.setenv("AVS3D_SH3F", str(tmp_path))
    (finding,) = generators.run.doctor._assets()
    assert finding.state == "missing"
    assert str(tmp_path) in finding.found
    assert "AVS3D_SH3F" in finding.fix
    (tmp_path / "a.sh3f").write_bytes(b"x")
    assert generators.run.doctor._assets()[0].state == "ok"


def test_a_file_in_the_way_of_the_cache_is_broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    import generators.run.doctor

    (tmp_path / "file").write_bytes(b"x")
    monkeypatch.setenv("AVS3D_CACHE", str(tmp_path / "file" / "cache"))
    (finding,) = generators.run.doctor._cache()
    assert finding.state == "broken"


def test_programs_in_turn_share_a_process_and_their_names_stay_apart() -> None:
    told = run_in_turn(["import os; x = 1; print(os.getpid())", "import os; print(os.getpid())", "print('x' in dir())"])
    assert [works for works, _ in told] == [True, True, True]
    assert told[0] == told[1]
    assert told[2] == (True, "False")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("breaks", "says"),
    [("import os; os.abort()", "ended by signal 6"), ("raise ValueError('b')", "ValueError: b"),
     ("raise SystemExit(3)", ""), ("import time; time.sleep(60)", "did not answer within 2 s")],
)  # fmt: skip
def test_a_program_that_breaks_takes_no_other_with_it(breaks: str, says: str) -> None:
    told = run_in_turn(["print('before')", breaks, "print('after')"], limit=2)
    assert told == [(True, "before"), (False, says), (True, "after")]
