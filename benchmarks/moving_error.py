"""A moving source against very many static responses: the error of the whole clip, late sound included.

    python -m benchmarks.moving_error [--responses 1000] [--head] [--json FILE]

A source goes 0.27 m in half a second in a box of 6 × 2.7 × 4 m, with noise of 200 Hz to 4 kHz. `Engine.render` is
compared with the signal cross-faded through responses of `Engine.responses` at places evenly along the way, made with
the same engine. One line for rays, one for fixed carriers (`TraceSettings.fixed_carriers`): the energy of the
difference relative to the clip (dB); the same of half as many responses, which is how far the comparison itself is
settled; CPU seconds of the clip and of the responses. Takes 4 to 7 minutes of CPU per line with 1,000 responses.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators import acoustics
from generators.acoustics.clips import MovingSource, heard_from

F64 = NDArray[np.float64]

RATE, SECONDS = 16_000, 0.5
START, END, LISTENER = np.array([1.0, 1.5, 1.5]), np.array([1.25, 1.4, 1.6]), (4.2, 1.2, 2.9)
#: Samples at the beginning that are left out: nothing has arrived yet.
SILENT = 1000


def noise() -> F64:
    """(n,) noise of 200 Hz to 4 kHz."""
    count = int(RATE * SECONDS)
    spectrum = np.fft.rfft(np.random.default_rng(0).standard_normal(count))
    frequency = np.fft.rfftfreq(count, 1 / RATE)
    spectrum[(frequency < 200) | (frequency > 4000)] = 0
    return np.fft.irfft(spectrum)


class Through:
    """The sound through responses at ``count`` places, as they come."""

    def __init__(self, signal: F64, channels: int, count: int) -> None:
        knots = np.rint(np.linspace(0, len(signal), count)).astype(np.int64)
        self._signal, self._moving = signal, MovingSource(knots, np.zeros(count))
        self.sound = np.zeros((channels, len(signal)))

    def add(self, k: int, response: NDArray[np.float32]) -> None:
        """Add what leaves the source about place ``k``."""
        offset, heard = heard_from(self._signal, response, self._moving, k, (0, len(self._signal)))
        self.sound[:, offset : offset + heard.shape[1]] += heard


def difference(found: NDArray[Any], wanted: F64) -> float:
    """Energy of the difference relative to ``wanted``, dB."""
    a, b = found[:, SILENT:], wanted[:, SILENT:]
    return float(10 * np.log10(np.square(a - b).sum() / np.square(b).sum()))


def measured(fixed: bool, receiver: Any, responses: int) -> dict[str, Any]:
    """The figures of one line; an odd number of ``responses``, so that every second one begins and ends the way."""
    responses += 1 - responses % 2
    room, signal = acoustics.Room.shoebox((6, 2.7, 4), {"floor": 0.3, "*": 0.2}), noise()
    engine = acoustics.Tracer(seed=1, settings=acoustics.TraceSettings(fixed_carriers=fixed))
    engine.response(room, START, LISTENER, receiver, sample_rate=RATE)  # compiled kernels are not part of the cost
    begin = time.process_time()
    heard = engine.render(room, signal, [(0.0, START), (SECONDS, END)], LISTENER, receiver, sample_rate=RATE)
    cost = time.process_time() - begin
    places = START + np.linspace(0, 1, responses)[:, None] * (END - START)
    all_, half = (Through(signal, len(heard), count) for count in (responses, responses // 2 + 1))
    begin = time.process_time()
    for k, rir in enumerate(engine.responses(room, places, [LISTENER], receiver=receiver, sample_rate=RATE)):
        all_.add(k, rir.samples)
        if k % 2 == 0:
            half.add(k // 2, rir.samples)
    return {
        "late": "fixed carriers" if fixed else "rays",
        "responses": responses,
        "difference_db": round(difference(heard, all_.sound), 1),
        "half_as_many_db": round(difference(half.sound, all_.sound), 1),
        "render_cpu_s": round(cost, 1),
        "responses_cpu_s": round(time.process_time() - begin, 1),
    }


def main() -> None:
    """Print both lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--responses", type=int, default=1000)
    parser.add_argument("--head", action="store_true", help="two ears instead of a point")
    parser.add_argument("--late", choices=("rays", "fixed"), help="one line alone")
    parser.add_argument("--json", type=Path, help="also write the records here")
    given = parser.parse_args()
    records = []
    for fixed in (False, True):
        if given.late in (None, "fixed" if fixed else "rays"):
            receiver = acoustics.SphericalHead() if given.head else acoustics.Omni()
            records.append(measured(fixed, receiver, given.responses))
            print(json.dumps(records[-1]), flush=True)
    if given.json is not None:
        given.json.write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
