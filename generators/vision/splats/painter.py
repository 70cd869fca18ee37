"""What draws splats: the protocol, and our own rasteriser on the CPU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from generators.core.scene import F32
from generators.vision.splats import kernels
from generators.vision.splats.cloud import SplatCloud

if TYPE_CHECKING:
    from generators.vision.splats.kernels import SplatCamera


@dataclass(frozen=True, eq=False)
class SplatLayers:
    """Splats in the pixels of a picture.

    Attributes:
        whole: (H, W, 5) float32 of all: Σ T·α·colour (sRGB values), what is left of the light behind (transmittance
            T), and Σ T·α/z (1/m).
        front: (H, W, 4) float32, the first four of those in front of the object in the pixel.
    """

    whole: F32
    front: F32

    def depth(self) -> F32:
        """(H, W) float32 expected depth along the optical axis (m): by the mean of 1/z; 0 where there is nothing."""
        light = 1.0 - self.whole[..., 3]
        out: F32 = np.divide(light, self.whole[..., 4], out=np.zeros_like(light), where=self.whole[..., 4] > 0)
        return out


class Painter(Protocol):
    """Draws one cloud."""

    def paint(self, camera: SplatCamera, cut: F32) -> SplatLayers:
        """Draw the cloud.

        Args:
            camera: from where.
            cut: (H, W) float32, 1/depth of the object in each pixel (1/m), 0 where there is none.
        """
        ...


class NumbaPainter:
    """Draws on the CPU, on one core; the same input gives the same bits. For several threads at once."""

    def __init__(self, cloud: SplatCloud) -> None:
        self._cloud = cloud

    def paint(self, camera: SplatCamera, cut: F32) -> SplatLayers:
        """See `Painter`."""
        tiles = (-(-camera.height // kernels.TILE), -(-camera.width // kernels.TILE))
        return self.paint_tiles(camera, cut, np.ones(tiles[0] * tiles[1], dtype=np.uint8))

    def paint_tiles(self, camera: SplatCamera, cut: F32, wanted: NDArray[np.uint8]) -> SplatLayers:
        """As `paint`, but tiles that are not ``wanted`` (tiles,) stay empty."""
        cloud, count = self._cloud, len(self._cloud)
        rows = np.empty((count, kernels.ROW), dtype=np.float32)
        boxes, depths = np.empty((count, 4), dtype=np.int32), np.empty(count, dtype=np.float32)
        found = kernels.project(cloud.means, cloud.covariances, cloud.opacities, cloud.sh, camera, rows, boxes, depths)
        order = np.argsort(depths[:found], kind="stable")
        rows, boxes = rows[order], boxes[order]
        wide = -(-camera.width // kernels.TILE)
        counts = np.zeros(len(wanted), dtype=np.int64)
        kernels.count_tiles(boxes, wide, wanted, counts)
        starts = np.concatenate([[0], np.cumsum(counts)])
        entries = np.empty(starts[-1], dtype=np.int32)
        kernels.fill_tiles(boxes, wide, wanted, starts[:-1].copy(), entries)
        layers = empty_layers(camera)
        kernels.composite(rows, boxes, starts, entries, wide, cut, layers.whole, layers.front)
        return layers


def empty_layers(camera: SplatCamera) -> SplatLayers:
    """Layers without any splat."""
    whole = np.zeros((camera.height, camera.width, 5), dtype=np.float32)
    front = np.zeros((camera.height, camera.width, 4), dtype=np.float32)
    whole[..., 3] = front[..., 3] = 1.0
    return SplatLayers(whole, front)
