"""The pictures that Gaussians are trained on and judged by, and the error when they do not fit into memory.

They are those of `images/`, undistorted and of the size of the cameras in `sparse/0`, as 3D-GS reads them; of `input/`
where a tree has no `images/`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.similarity import psnr
from baselines.echosegnet.views import RegisteredView, picture_folder

#: Pictures decoded at a time; more threads would only wait for each other.
_READERS = 8


def load_pictures(views: Sequence[RegisteredView], device: torch.device | str = "cpu") -> Tensor:
    """(V, H, W, 3) uint8 pictures of the views.

    Raises:
        Avs3dError: if a picture is missing, is no 8-bit RGB or not of its camera's size, or sizes differ.
    """
    if not views:
        raise Avs3dError("no view to train on; camera_splits.json names none as train")
    camera = views[0].camera
    for view in views:
        if (view.camera.height, view.camera.width) != (camera.height, camera.width):
            raise Avs3dError(
                f"{view.frame.observation.path}: cameras of several sizes; expected one size per observation"
            )
    with out_of_memory(f"{len(views)} pictures of {camera.width} × {camera.height}"):
        out = torch.empty((len(views), camera.height, camera.width, 3), dtype=torch.uint8, device=device)
        with ThreadPoolExecutor(_READERS) as readers:
            for index, picture in enumerate(readers.map(_picture, views)):
                out[index] = picture.to(out.device)
    return out


def _picture(view: RegisteredView) -> Tensor:
    folder = picture_folder(view.frame.observation)
    rgb = view.frame.undistorted_rgb() if folder == layout.IMAGES else view.frame.rgb()
    expected = (view.camera.height, view.camera.width, 3)
    if rgb.dtype != np.uint8 or rgb.shape != expected:
        raise Avs3dError(
            f"{view.frame.observation.key}/{folder}/{view.name}.png: {rgb.dtype} {rgb.shape}, expected uint8 "
            f"{expected} as in sparse/0/cameras.bin"
        )
    return torch.from_numpy(rgb)


@contextmanager
def out_of_memory(what: str) -> Iterator[None]:
    """Turn every form of "out of memory" into one line that names the option to lower.

    Raises:
        Avs3dError: in place of it.
    """
    try:
        yield
    except (RuntimeError, MemoryError) as error:
        text = str(error).lower()
        lacking = isinstance(error, MemoryError | torch.OutOfMemoryError) or "allocate memory" in text
        if not (lacking or "out of memory" in text):
            raise
        raise Avs3dError(f"out of memory with {what}: lower --max-gaussians, or free memory on the device") from None


def view_psnr(
    gaussians: Gaussians, views: Sequence[RegisteredView], rasteriser: Rasteriser, *, sh_degree: int = 3
) -> list[float]:
    """PSNR in dB of each view's picture, pixels clipped to [0, 1]."""
    pictures = load_pictures(views)
    out = []
    with torch.no_grad():
        for view, picture in zip(views, pictures, strict=True):
            rgb = rasteriser.render(gaussians, view, sh_degree=sh_degree).rgb.clamp(0.0, 1.0)
            out.append(psnr(rgb, picture.to(rgb.device) / 255.0))
    return out
