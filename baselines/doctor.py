"""Checks of `avs3d doctor` for the baselines: PyTorch, a GPU, gsplat, checkpoints."""

from __future__ import annotations

import os
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.doctor import Check, CheckResult, constant, package_check, package_finding, run_in_turn
from avs3d_bench.runtime.imports import has_package

_EXTRA = "pip install 'avs3d-bench[baselines]'"
_CUDA = """
import torch
if torch.cuda.is_available():
    names = [torch.cuda.get_device_properties(k) for k in range(torch.cuda.device_count())]
    torch.ones(8, device="cuda").sum().item()
    print("ok;" + ", ".join(f"{p.name} ({p.total_memory / 2**30:.0f} GiB)" for p in names))
elif torch.version.cuda is None:
    print(f"cpu;torch {torch.__version__} was built without CUDA")
else:
    print(f"none;torch was built for CUDA {torch.version.cuda}, and no device or driver answers")
"""
#: gsplat compiles its kernels on first use, which a check must not start: it only looks for kernels already built.
_GSPLAT = """
import gsplat
try:
    from gsplat import csrc
    print("kernels built")
except ImportError:
    print("kernels are compiled on first use (needs nvcc and a GPU); without a GPU the plain PyTorch rasteriser serves")
"""


#: Which option of which baseline takes the folder of a network.
OPTIONS = {
    "owlv2": "owod-bind --boxes-checkpoint",
    "mavl": "owod-bind --boxes-checkpoint",
    "sam": "owod-bind --sam-checkpoint",
    "imagebind": "owod-bind --similarity-checkpoint",
    "pe-av": "owod-bind --similarity-checkpoint",
    "denseav": "denseav --checkpoint",
    "clap": "foundation --clap-checkpoint",
    "sam3": "foundation --sam3-checkpoint",
    "grounding-dino": "foundation --grounding-dino-checkpoint",
    "sam2": "foundation --sam2-checkpoint",
}


def checks() -> tuple[Check, ...]:
    """Everything the baselines can make use of."""
    return (
        Check("baselines", "torch", _torch),
        package_check("baselines", "transformers", "transformers", _EXTRA, needed="OWOD-BIND"),
        package_check("baselines", "scikit-learn", "sklearn", _EXTRA, needed="the clusters of EchoSegnet"),
        *_checkpoints(),
    )


def _torch() -> tuple[CheckResult, ...]:
    """PyTorch, its device, and gsplat, which imports it: in one process, since the import takes seconds."""
    if not has_package("torch"):
        return (
            CheckResult("baselines", "torch", "missing", "not installed; every learned baseline", _EXTRA),
            CheckResult("baselines", "CUDA", "missing", "PyTorch is not installed", _EXTRA),
            CheckResult("baselines", "gsplat", "missing", "tried once PyTorch is there; EchoSegnet on a GPU", _EXTRA),
        )
    there = has_package("gsplat")
    torch, cuda, *gsplat = run_in_turn(["import torch", _CUDA, *([_GSPLAT] if there else [])])
    last = (
        package_finding("baselines", "gsplat", _EXTRA, gsplat[0])
        if there
        else CheckResult("baselines", "gsplat", "missing", "not installed; EchoSegnet on a GPU", _EXTRA)
    )
    return (package_finding("baselines", "torch", _EXTRA, torch), *_cuda(*cuda), last)


def _cuda(works: bool, said: str) -> tuple[CheckResult, ...]:
    fix = "install a PyTorch build for your driver: https://pytorch.org/get-started/locally"
    state, _, text = said.partition(";")
    if not works:
        return (CheckResult("baselines", "CUDA", "broken", said, fix),)
    if state == "ok":
        return (CheckResult("baselines", "CUDA", "ok", text),)
    return (CheckResult("baselines", "CUDA", "missing", f"{text}; EchoSegnet at full size needs a GPU", fix),)


def _checkpoints() -> tuple[Check, ...]:
    """One check for each network, below the folder that AVS3D_CHECKPOINTS names."""
    from baselines.networks.checkpoints import CHECKPOINTS

    named = os.environ.get("AVS3D_CHECKPOINTS")
    if not named:
        names = ", ".join(f"{kind}/ ({each.licence}, {each.size})" for kind, each in CHECKPOINTS.items())
        fix = (
            f"export AVS3D_CHECKPOINTS=FOLDER with {names} below (for this check), and pass each to its baseline: "
            + ", ".join(f"{kind}/ with {option}" for kind, option in OPTIONS.items())
        )
        return (constant("checkpoints", "checkpoints", "missing", "AVS3D_CHECKPOINTS is not set", fix),)
    root = Path(named)
    if not root.is_dir():
        return (constant("checkpoints", "checkpoints", "broken", f"{root}: no such folder", "correct its name"),)
    return tuple(Check("checkpoints", kind, lambda kind=kind: _checkpoint(kind, root / kind)) for kind in CHECKPOINTS)  # type: ignore[misc]


def _checkpoint(kind: str, folder: Path) -> tuple[CheckResult, ...]:
    from baselines.networks.checkpoints import CHECKPOINTS, PINS, find_checkpoint

    checkpoint = CHECKPOINTS[kind]
    try:
        found = find_checkpoint(kind, folder, verify=False)
    except Avs3dError as error:
        said, _, _ = str(error).partition("; put ")
        state = "broken" if "empty" in said else "missing"
        return (CheckResult("checkpoints", checkpoint.name, state, said, f"in {folder}: {checkpoint.advice}"),)  # type: ignore[arg-type]
    size = sum(path.stat().st_size for path in found.values()) / 1e9
    lacking = [package for package in checkpoint.packages if not has_package(package)]
    if lacking:
        said = f"{folder} ({size:.1f} GB), but the package {lacking[0]} is not installed"
        return (CheckResult("checkpoints", checkpoint.name, "missing", said, checkpoint.install),)
    pinned = f"pinned by {PINS}" if (folder / PINS).exists() else f"not pinned: no {PINS}"
    said = f"{folder} ({size:.1f} GB, {checkpoint.licence}, {pinned})"
    return (CheckResult("checkpoints", checkpoint.name, "ok", said),)
