"""Checks of `avs3d doctor` for the generator: renderers, acoustic engines, scans, assets."""

from __future__ import annotations

import os
import shutil
from importlib.metadata import version
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.doctor import Check, CheckResult, constant, package_check, run_python
from avs3d_bench.runtime.imports import has_package
from avs3d_bench.runtime.user_path import user_path

_EXTRA = "pip install 'avs3d-bench[generate]'"
#: Scans of the paper's benchmark (their ids are published).
PAPER_SCANS = ("5ZKStnWn8Zo", "q9vSo1VnCiC", "sT4fr6TAbpF", "wc2JMjhGNzB")
#: Pins the scans of scenes_manifest/open-scans.yaml.
OPEN_LOCK = Path(__file__).resolve().parents[2] / "scenes_manifest" / "assets.lock.yaml"
#: Where Debian's package sweethome3d-furniture puts its libraries.
FURNITURE = Path("/usr/share/sweethome3d/furniture")

_RAY = """
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
scene = rtcore_scene.EmbreeScene()
TriangleMesh(scene, np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=np.float32))
hit = scene.run(np.array([[.2, .2, 1]], dtype=np.float32), np.array([[0, 0, -1]], dtype=np.float32))
assert hit[0] == 0, "a ray missed the triangle before it"
"""
#: One second of the engine in an empty box: it has been seen to crash on machines whose processor it does not suit.
_ENGINE = """
import numpy as np
from generators.acoustics.soundspaces import RaySettings, SoundSpacesBackend
from generators.run.doctor import trial_room
from avs3d_bench.geometry import Pose
backend = SoundSpacesBackend(RaySettings(reflections=1000, min_rays=50, max_rays=50))
session = backend.open(trial_room(), (1.0, 1.2, -1.0), room="kitchen")
response = session.impulse_response(Pose.from_yaw((-1.0, 1.5, 1.0), 0.0))
session.close()
print(f"an impulse response of {response.shape[1] / 44100:.2f} s in a test room (CC-BY-NC 4.0)")
"""
#: The device, or the reason why there is none; a kernel that is compiled and run on it.
_CUDA = """
import numpy as np
from generators.core.cuda import cuda_problem, kernel, launch, require_device, upload
if cuda_problem():
    print("note:", cuda_problem())
else:
    device = require_device()
    from numba import cuda
    def double(values):
        i = cuda.grid(1)
        if i < values.shape[0]:
            values[i] *= 2.0
    values = upload(np.ones(1000))
    launch(cuda.jit(double), len(values), values)
    assert (values.copy_to_host() == 2.0).all(), "a kernel returned wrong numbers"
    print(f"--device cuda: {device}")
"""
_PATHTRACED = """
from avs3d_bench.errors import Avs3dError
from generators.vision.pathtraced import PathtracedBackend
try:
    print("--vision pathtraced: Mitsuba", PathtracedBackend().version)
except Avs3dError as error:
    raise SystemExit(str(error))
"""
_JIT = """
import numba
assert numba.njit(lambda x: x + 1)(1) == 2
"""


def trial_room():  # type: ignore[no-untyped-def]  # the record's module is heavy
    """A room of 4 × 2.5 × 4 m for the engines' trial."""
    from generators.assets.shapes import MeshBuilder
    from generators.core.scene import Material, Part, Room, Scene

    mesh = MeshBuilder().box((4.0, 2.5, 4.0), (0.0, 1.25, 0.0), Material("wall", "plaster")).build()
    return Scene("test room", (Part("walls", mesh),), (Room("kitchen", (-2, 0, -2), (2, 2.5, 2)),), ())


def checks() -> tuple[Check, ...]:
    """Everything the generator can make use of."""
    return (
        package_check("generate", "embreex", "embreex", _EXTRA, program=_RAY, needed="the renderer"),
        package_check("generate", "numba", "numba", _EXTRA, program=_JIT, needed="shading"),
        package_check("generate", "trimesh", "trimesh", _EXTRA, needed="mesh files"),
        package_check("generate", "xatlas", "xatlas", _EXTRA, needed="light maps"),
        package_check(
            "generate",
            "mitsuba",
            "mitsuba",
            "pip install 'avs3d-bench[pathtraced]' (without an NVIDIA GPU it also needs LLVM: apt install libllvm19)",
            program=_PATHTRACED,
            needed="--vision pathtraced",
        ),
        _engine(),
        package_check("generate", "h5py", "h5py", "pip install 'avs3d-bench[sofa]'", needed="heads of SOFA files"),
        Check("generate", "numba-cuda", _cuda),
        Check("generate", "cache of homes", _cache),
        Check("generate", "splats", _splats),
        Check("habitat", "habitat-sim", _habitat),
        Check("scans", "scans", _scans),
        Check("scans", "free scans", _free_scans),
        Check("assets", "assets", _assets),
        *(_token(*names) for names in (("SKETCHFAB_TOKEN", "Sketchfab"), ("FREESOUND_TOKEN", "Freesound"))),
    )


def _cuda() -> tuple[CheckResult, ...]:
    fix = "pip install 'avs3d-bench[cuda]' (on a machine with an NVIDIA GPU)"
    if not has_package("numba_cuda"):
        return (CheckResult("generate", "numba-cuda", "missing", "not installed; --device cuda", fix),)
    if not has_package("numba"):
        return (CheckResult("generate", "numba-cuda", "note", "installed; tried once [generate] is there", _EXTRA),)
    works, said = run_python(_CUDA)
    if not works:
        fix = "check nvidia-smi; a driver before 580 needs pip install 'numba-cuda[cu12]'"
        return (CheckResult("generate", "numba-cuda", "broken", said, fix),)
    if said.startswith("note: "):
        return (CheckResult("generate", "numba-cuda", "note", f"{said[6:]}; --device cpu works", ""),)
    return (CheckResult("generate", "numba-cuda", "ok", said),)


def _splats() -> tuple[CheckResult, ...]:
    """What draws with ``--vision splats``."""
    if not has_package("numba"):
        return (CheckResult("generate", "splats", "missing", "needs numba; --vision splats", _EXTRA),)
    ours = "--vision splats: our rasteriser on the CPU"
    if has_package("gsplat") and has_package("torch"):
        return (CheckResult("generate", "splats", "ok", f"{ours}; with --device cuda, gsplat {version('gsplat')}"),)
    fix = "pip install 'avs3d-bench[baselines]' (on a machine with an NVIDIA GPU)"
    return (CheckResult("generate", "splats", "note", f"{ours}; --device cuda needs gsplat and torch", fix),)


def _engine() -> Check:
    fix = "pip install 'avs3d-bench[soundspaces]' (needs a C++ compiler), or generate with --audio tracer"
    if has_package("rlr_audio_propagation") and not all(has_package(name) for name in ("trimesh", "shapely")):
        return constant("generate", "rlr-audio-propagation", "note", "installed; tried once [generate] is there")
    needed = "the acoustic engine of SoundSpaces 2.0"
    return package_check(
        "generate", "rlr-audio-propagation", "rlr_audio_propagation", fix, program=_ENGINE, needed=needed
    )


def _habitat() -> tuple[CheckResult, ...]:
    python = os.environ.get("AVS3D_HABITAT_PYTHON", "")
    if not python:
        fix = (
            "conda create -n habitat python=3.9 habitat-sim headless -c conda-forge -c aihabitat, then "
            "export AVS3D_HABITAT_PYTHON=…/envs/habitat/bin/python"
        )
        return (
            CheckResult("habitat", "habitat-sim", "missing", "AVS3D_HABITAT_PYTHON is not set; --vision habitat", fix),
        )
    if not has_package("trimesh"):
        return (CheckResult("habitat", "habitat-sim", "note", f"{python}: tried once [generate] is there", _EXTRA),)
    from generators.vision.habitat import probe

    works, said = probe(python)
    if works:
        return (CheckResult("habitat", "habitat-sim", "ok", said),)
    fix = "name an interpreter with habitat-sim in AVS3D_HABITAT_PYTHON; without a GPU it needs EGL (libegl1, Mesa)"
    return (CheckResult("habitat", "habitat-sim", "broken", said, fix),)


def _scans() -> tuple[CheckResult, ...]:
    fix = "export AVS3D_SCANS=FOLDER with HM3D or Matterport3D below (both are free for research, on request)"
    named = os.environ.get("AVS3D_SCANS")
    if not named:
        return (CheckResult("scans", "scans", "missing", "AVS3D_SCANS is not set; procedural homes need none", fix),)
    try:
        root = user_path(named)
    except Avs3dError as error:
        return (CheckResult("scans", "scans", "broken", str(error), fix),)
    if not root.is_dir():
        return (CheckResult("scans", "scans", "broken", f"{root}: no such folder", fix),)
    if not has_package("trimesh"):
        return (CheckResult("scans", "scans", "note", f"{root}: looked at once [generate] is there", _EXTRA),)
    from generators.scans.files import find_scan_files

    found = []
    for scan in PAPER_SCANS:
        try:
            find_scan_files(scan, root)
        except Avs3dError:
            continue
        found.append(scan)
    absent = [scan for scan in PAPER_SCANS if scan not in found]
    if not absent:
        return (CheckResult("scans", "scans", "ok", f"{root}: all {len(found)} scans of 3davs-s34-o7"),)
    said = f"{root}: {len(found)} of the {len(PAPER_SCANS)} scans of 3davs-s34-o7, not {', '.join(absent)}"
    return (CheckResult("scans", "scans", "note", said, "put <id>/<id>.glb of Matterport3D below that folder"),)


def _free_scans() -> tuple[CheckResult, ...]:
    """The pinned scans that open-scans.yaml uses: those that are in the store, and those that are not."""
    if not has_package("trimesh"):
        return (CheckResult("scans", "free scans", "note", "looked at once [generate] is there", _EXTRA),)
    from generators.library.lock import read_lock
    from generators.library.store import Store

    try:
        store = Store.default()
        entries = [entry for entry in read_lock(OPEN_LOCK).assets if entry.kind == "scan"]
    except Avs3dError as error:
        return (CheckResult("scans", "free scans", "broken", str(error), "correct the file, or AVS3D_ASSETS"),)
    if not entries:
        return (CheckResult("scans", "free scans", "missing", f"{OPEN_LOCK} names none", "get it from the repository"),)
    named = {entry.id: f"{entry.id} ({entry.licence})" for entry in entries}
    absent = [named[entry.id] for entry in entries if store.problem(entry)]
    fix = "avs3d assets fetch --manifest scenes_manifest/open-scans.yaml"
    if len(absent) == len(entries):
        return (CheckResult("scans", "free scans", "missing", f"not in the store: {', '.join(absent)}", fix),)
    here = ", ".join(text for text in named.values() if text not in absent)
    if absent:
        return (CheckResult("scans", "free scans", "note", f"{here}; not in the store: {', '.join(absent)}", fix),)
    return (CheckResult("scans", "free scans", "ok", f"in the store: {here}"),)


def _assets() -> tuple[CheckResult, ...]:
    folder = Path(os.environ.get("AVS3D_SH3F") or FURNITURE)
    libraries = sorted(folder.glob("*.sh3f"))
    if libraries:
        found = f"{len(libraries)} Sweet Home 3D libraries in {folder}"
        return (CheckResult("assets", "Sweet Home 3D", "ok", found),)
    if folder != FURNITURE:
        fix = "export AVS3D_SH3F=FOLDER with the .sh3f files, or unset it and apt install sweethome3d-furniture"
    else:
        fix = "apt install sweethome3d-furniture, then avs3d assets import sh3f /usr/share/sweethome3d/furniture"
    return (CheckResult("assets", "Sweet Home 3D", "missing", f"no *.sh3f in {folder}; open-s34-o7-sh3d", fix),)


def _token(variable: str, service: str) -> Check:
    if os.environ.get(variable):
        return constant("assets", service, "ok", f"{variable} is set")
    return constant("assets", service, "missing", f"{variable} is not set; fetching from {service}",
                    f"export {variable}=… (from your {service} account)")  # fmt: skip


def _cache() -> tuple[CheckResult, ...]:
    from generators.core.folders import default_cache

    if not os.environ.get("AVS3D_CACHE") and not has_package("platformdirs"):
        return (CheckResult("generate", "cache of homes", "note", "looked at once [generate] is there", _EXTRA),)
    try:
        folder = default_cache()
    except Avs3dError as error:
        return (CheckResult("generate", "cache of homes", "broken", str(error), "export AVS3D_CACHE=FOLDER"),)
    there = next(path for path in (folder, *folder.parents) if path.exists())
    free = shutil.disk_usage(there).free / 1e9
    if not there.is_dir() or not os.access(there, os.W_OK):
        fix = "export AVS3D_CACHE=FOLDER that can be written to"
        return (CheckResult("generate", "cache of homes", "broken", f"{folder}: cannot be written to", fix),)
    found = f"{folder}, {free:.0f} GB free (a home takes 0.1)"
    if free < 2:
        return (CheckResult("generate", "cache of homes", "note", found, "export AVS3D_CACHE=FOLDER on a larger disk"),)
    return (CheckResult("generate", "cache of homes", "ok", found),)
