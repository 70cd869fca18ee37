"""Tasks for the tests of EchoSegnet's scheduling, in a module of their own so that worker processes can import them."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Frame
from avs3d_bench.scheduling.tasks import Context
from baselines.echosegnet.jobs import device_of
from baselines.echosegnet.sources import OracleMasks


@dataclass(frozen=True)
class Meeting:
    """A job that is done only while another one runs."""

    key: str
    folder: Path
    devices: tuple[str, ...]


def meet(context: Context, job: Meeting) -> tuple[str, int]:
    """Wait until two jobs have begun; the device, and the slot."""
    (job.folder / job.key).touch()
    end = time.monotonic() + 60
    while len(list(job.folder.iterdir())) < 2:
        assert time.monotonic() < end, "the other job never began"
        time.sleep(0.05)
    return str(device_of(context, job.devices).device), context.slot


@dataclass(frozen=True)
class DeadlyMasks(OracleMasks):
    """Masks that kill the process when they are asked for one of ``key``, ``times`` times.

    Attributes:
        key: of the observation.
        folder: for a file per kill.
        times: how often.
    """

    key: str = ""
    folder: Path = Path()
    times: int = 99

    def mask(self, frame: Frame) -> NDArray[np.bool_]:
        """The oracle's, if the process lives."""
        killed = len(list(self.folder.glob("killed-*")))
        if frame.observation.key == self.key and killed < self.times:
            (self.folder / f"killed-{killed}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().mask(frame)
