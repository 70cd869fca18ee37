"""A signal as a moving receiver hears it from a moving source, without seams.

Engines that tell single arrivals (the tracer): the direct sound and the specular reflections are followed from knot to
knot along the way (`Early`). Each keeps its own delay, direction and level at every moment, with the source where it
was when the sound left it: Doppler shift, distance and interaural differences are exact to the step of the receiver's
filters, which are renewed every `_STEP_EARLY` metres of path and cross-faded. All other sound (diffracted, scattered)
is cross-faded between responses at coarser knots, at a level that does not pump.

Other engines: whole responses at knots are cross-faded as the generator does it (`clips.moving_clip`): the source
signal where the source moves, the result where the listener does, with their direct sounds aligned to arrive together
at the delay of the moment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from generators.acoustics.base import AcousticSession, ArrivalSession, BatchSession
from generators.acoustics.clips import MovingSource, delayed, heard_from, levelled
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracks import PoseTrack

if TYPE_CHECKING:
    from generators.acoustics.tracer.receivers.base import Receiver

F64 = NDArray[np.float64]

#: Change of a path's length (m) after which the filters of the early sound are renewed: a twelfth of the wavelength at
#: 10 kHz, at which the cross-fade of two filters loses 0.3 dB there, and 0.1 dB below 6 kHz.
_STEP_EARLY = 0.003
#: Least and most samples between two filters.
_LEAST_HOP, _MOST_HOP = 16, 1024
#: Tolerance (m) of an image's way between two knots, which is as long as the source's.
_SAME_WAY = 2e-3
#: Rounds of the iteration for the time of emission; each gains a factor of speed over speed of sound.
_ROUNDS = 6


def render(
    session: AcousticSession,
    receiver: Receiver | None,
    signal: F64,
    way: Way,
    steps: tuple[float, float],
) -> NDArray[np.float32]:
    """See `generators.acoustics.engines.Engine.render`.

    Args:
        session: open, with the source where its track begins.
        receiver: of the arrivals, if the session tells them; None: it does not.
        signal: (n,).
        way: how source and listener move.
        steps: metres, and radians of a turn, between two responses.

    Returns:
        (channels, n) float32.
    """
    if not (way.source_changes or way.listener.moves or way.listener.turns):
        response = session.impulse_response(way.listener.pose_at(0.0))
        fixed = MovingSource(np.zeros(1, dtype=np.int64), np.zeros(1))
        return heard_from(signal, response, fixed, 0, (0, way.count))[1].astype(np.float32)
    if isinstance(session, ArrivalSession) and receiver is not None:
        out = _early(session, receiver, signal, way, steps)
        rest = _Rest(session, receiver)
        coarser = session.late_step / steps[0]
        coarse = (session.late_step, max(coarser, 1.0) * steps[1])
        return (out + _knotted(rest, signal, way, coarse)).astype(np.float32)
    return _knotted(_Whole(session), signal, way, steps).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Way:
    """How source and listener move.

    Attributes:
        sample_rate: Hz.
        count: samples of the signal.
        source: track of the source.
        listener: track of the listener.
        is_directional: whether the source has a directivity, so that its turns are heard.
    """

    sample_rate: int
    count: int
    source: PoseTrack
    listener: PoseTrack
    is_directional: bool = False

    @property
    def seconds(self) -> float:
        """Length of the signal, s."""
        return self.count / self.sample_rate

    @property
    def source_changes(self) -> bool:
        """Whether responses of the source change with time."""
        return self.source.moves or (self.is_directional and self.source.turns)

    def source_knots(self, steps: tuple[float, float]) -> F64:
        """Times at which the source is put elsewhere, or turned."""
        return self.source.knots(self.seconds, steps[0], steps[1] if self.is_directional else None)

    def put_source(self, session: AcousticSession, seconds: float) -> None:
        """Put the source of a session where it is at a time."""
        pose = self.source.pose_at(seconds)
        session.move_source(pose if self.is_directional else pose.position)


class _Whole:
    """Whole responses of a session, direct sounds aligned."""

    aligns = True

    def __init__(self, session: AcousticSession) -> None:
        self.session = session

    def response(self, way: Way, seconds: float) -> NDArray[np.float32]:
        """Response at the listener's pose at a time, from where the source is put."""
        return self.session.impulse_response(way.listener.pose_at(seconds))


class _Rest:
    """Responses to all arrivals but those that are followed one by one."""

    aligns = False

    def __init__(self, session: ArrivalSession, receiver: Receiver) -> None:
        self.session, self._receiver = session, receiver

    def response(self, way: Way, seconds: float) -> NDArray[np.float32]:
        """Response at the listener's pose at a time, from where the source is put."""
        pose = way.listener.pose_at(seconds)
        found = self.session.arrivals(pose)
        rest = ~found.is_spherical
        late = Arrivals(found.time[rest], found.direction[rest], found.pressure[rest])
        return self._receiver.response(late, pose.rotation_matrix, way.sample_rate)


def _knotted(heard: _Whole | _Rest, signal: F64, way: Way, steps: tuple[float, float]) -> F64:
    """(channels, n) the sound through responses at knots of both tracks."""
    rate, count = way.sample_rate, way.count
    sources = way.source_knots(steps)
    listeners = way.listener.knots(way.seconds, *steps)
    at = np.rint(sources * rate).astype(np.int64)
    ends = np.rint(listeners * rate).astype(np.int64)
    ends[0], ends[-1] = 0, max(count, ends[-1])
    places = way.source.position_at(sources)
    ears = way.listener.position_at(listeners)
    lags = np.linalg.norm(places[:, None] - ears[None], axis=-1) / SPEED_OF_SOUND * rate
    correlation = _correlation(heard, way, (sources, listeners), lags)
    out = np.zeros((0, count))
    reach = 0  # samples of the longest response so far
    for k, seconds in enumerate(sources):
        session = heard.session
        way.put_source(session, float(seconds))
        mine = [m for m in range(len(ends)) if _meets(at, k, ends, m, reach, count)]
        if isinstance(session, BatchSession):
            session.prepare([way.listener.pose_at(float(listeners[m])) for m in mine])
        for m in mine:
            response = heard.response(way, float(listeners[m]))
            reach = max(reach, response.shape[1])
            out = out if len(out) else np.zeros((len(response), count))
            first, last = int(ends[max(m - 1, 0)]), int(ends[min(m + 1, len(ends) - 1)])
            first, last = (0, count) if len(ends) == 1 else (first, min(last, count))
            moving = MovingSource(at, lags[:, m] if heard.aligns else np.zeros(len(at)), correlation)
            offset, sound = heard_from(signal, response, moving, k, (first, last))
            if not sound.shape[1]:
                continue
            n = np.arange(first + offset, first + offset + sound.shape[1])
            if len(ends) > 1:
                sound = _at_listener(sound, n, heard, way, m, ears, ends, correlation)
            out[:, n] += sound
    return out


def _meets(at: NDArray[np.int64], k: int, ends: NDArray[np.int64], m: int, reach: int, count: int) -> bool:
    """Whether what leaves the source about knot k can be heard about the listener's knot m."""
    if len(at) == 1 or len(ends) == 1:
        return True
    leaves, ceases = (0 if k == 0 else int(at[k - 1])), (count if k + 1 == len(at) else int(at[k + 1]))
    begins, stops = int(ends[max(m - 1, 0)]), int(ends[min(m + 1, len(ends) - 1)])
    # The first pair tells how long responses are.
    return leaves < stops and (reach == 0 or begins < ceases + 2 * reach)


def _at_listener(
    sound: F64,
    n: NDArray[np.int64],
    heard: _Whole | _Rest,
    way: Way,
    m: int,
    ears: F64,
    ends: NDArray[np.int64],
    correlation: float,
) -> F64:
    """The sound at the listener's knot m, in its window, with the delay that the direct sound has at each moment."""
    window = levelled(np.interp(n, ends, np.eye(len(ends))[m]), correlation)
    if not heard.aligns:
        return np.asarray(window * sound)
    seconds = n / way.sample_rate
    places, at = way.source.position_at(seconds), way.listener.position_at(seconds)
    far = np.linalg.norm(places - at, axis=1) - np.linalg.norm(places - ears[m], axis=1)
    lag = far / SPEED_OF_SOUND * way.sample_rate
    return np.stack([window * delayed(channel, lag, 0) for channel in sound])


def _correlation(heard: _Rest | _Whole, way: Way, knots: tuple[F64, F64], lags: F64) -> float:
    """Correlation of the responses at the first two knots, 0 to 1; of whole responses with direct sounds aligned."""
    second = tuple(min(1, len(times) - 1) for times in knots)
    found = []
    for k, m in ((0, 0), second):
        way.put_source(heard.session, float(knots[0][k]))
        found.append(heard.response(way, float(knots[1][m])).astype(np.float64))
    if heard.aligns:
        shift = float(lags[second] - lags[0, 0])
        found[1] = np.stack([delayed(one, np.full(len(one), -shift), 0) for one in found[1]])
    length = min(one.shape[1] for one in found)
    a, b = (one[:, :length] for one in found)
    energy = math.sqrt(float(np.square(a).sum()) * float(np.square(b).sum()))
    alike = min(max(float((a * b).sum()) / energy, 0.0), 1.0) if energy > 0 else 1.0
    # Where both move, each has half a part in it.
    return math.sqrt(alike) if min(map(len, knots)) > 1 else alike


@dataclass(eq=False)
class _Image:
    """One image of the source, followed from knot to knot.

    Attributes:
        first: its first knot.
        places: where it is at its knots, metres.
        levels: (8,) pressure times distance at its knots.
        is_direct: whether it is the source itself.
    """

    first: int
    places: list[F64]
    levels: list[F64]
    is_direct: bool
    last: int = field(init=False)

    def __post_init__(self) -> None:
        self.last = self.first


def _early(session: ArrivalSession, receiver: Receiver, signal: F64, way: Way, steps: tuple[float, float]) -> F64:
    """(channels, n) the direct sound and the specular reflections."""
    knots = _joint_knots(way, steps)
    images = _followed(session, way, knots)
    out = np.zeros((receiver.channels, way.count))
    hops = _hops(way, knots)
    responses: list[NDArray[np.float32]] = []
    for number, arrivals in enumerate(_early_arrivals(images, way, knots, hops / way.sample_rate)):
        rotation = way.listener.pose_at(hops[number] / way.sample_rate).rotation_matrix
        responses.append(receiver.response(arrivals, rotation, way.sample_rate))
        if number > 0:
            _add_between(out, signal, responses, (int(hops[number - 1]), int(hops[number])))
            responses.pop(0)
    return out


def _joint_knots(way: Way, steps: tuple[float, float]) -> F64:
    """Times at which images are looked for: neither end has moved by more than a step since the last one."""
    both = np.concatenate([way.source_knots(steps), way.listener.knots(way.seconds, steps[0])])
    knots = np.unique(np.concatenate([both, [0.0, way.seconds]]))
    return np.asarray(knots[np.concatenate([[True], np.diff(knots) > 1e-6])])


def _hops(way: Way, knots: F64) -> NDArray[np.int64]:
    """Samples at which filters are renewed."""
    hops = [0]
    for start, end in pairwise(knots):
        places = [track.position_at(np.linspace(start, end, 9)) for track in (way.source, way.listener)]
        far = sum(float(np.linalg.norm(np.diff(each, axis=0), axis=1).sum()) for each in places)
        turned = _turned(way.listener, start, end) * HEAD_RADIUS
        samples = (end - start) * way.sample_rate
        hop = min(max(samples * _STEP_EARLY / max(far + turned, 1e-9), _LEAST_HOP), _MOST_HOP)
        pieces = max(math.ceil(samples / hop), 1)
        hops += [round((start + (end - start) * (i + 1) / pieces) * way.sample_rate) for i in range(pieces)]
    hops[-1] = way.count
    return np.unique(np.array(hops, dtype=np.int64))


def _turned(track: PoseTrack, start: float, end: float) -> float:
    """Angle (radians) by which the listener turns."""
    if not track.turns:
        return 0.0
    a, b = (np.array(track.pose_at(at).rotation) for at in (start, end))
    return float(2 * np.arccos(min(abs(float((a * b).sum())), 1.0)))


def _followed(session: ArrivalSession, way: Way, knots: F64) -> list[_Image]:
    """The images of the source at all knots, those of one mirror joined.

    A reflection moves an image by as much as the source moves: that tells the same image at the next knot.
    """
    images: list[_Image] = []
    alive: list[_Image] = []
    places = way.source.position_at(knots)
    for k, seconds in enumerate(knots):
        pose = way.listener.pose_at(float(seconds))
        way.put_source(session, float(seconds))
        found = session.early(pose)
        distance = found.time * SPEED_OF_SOUND
        at = np.asarray(pose.position) + found.direction * distance[:, None]
        level = found.pressure * np.maximum(distance, 1e-3)[:, None]
        moved = float(np.linalg.norm(places[k] - places[k - 1])) if k else 0.0
        matched = _matched(alive, at, level, moved)
        now = []
        for i in range(len(found)):
            image = matched.get(i)
            if image is None:
                direct = float(np.linalg.norm(at[i] - places[k])) < _SAME_WAY
                image = _Image(k, [], [], direct)
                images.append(image)
            image.places.append(at[i])
            image.levels.append(np.asarray(level[i], dtype=np.float64))
            image.last = k
            now.append(image)
        alive = now
    return images


def _matched(alive: list[_Image], at: F64, level: NDArray[np.floating], moved: float) -> dict[int, _Image]:
    """Number of an arrival → the image of the knot before that it goes on; each at most once."""
    if not alive or not len(at):
        return {}
    before = np.array([image.places[-1] for image in alive])
    levels = np.array([image.levels[-1] for image in alive])
    way = np.linalg.norm(at[None] - before[:, None], axis=-1)
    # Single-precision directions are known to 1e-7 of the distance.
    off = np.abs(way - moved) / (1 + 1e-3 * np.linalg.norm(before, axis=1))[:, None]
    apart = np.abs(level[None] - levels[:, None]).sum(axis=-1) / np.maximum(levels.sum(axis=-1), 1e-12)[:, None]
    cost = np.where(off < _SAME_WAY, off + 0.1 * apart, np.inf)
    found: dict[int, _Image] = {}
    used: set[int] = set()
    for flat in np.argsort(cost, axis=None, kind="stable"):
        j, i = divmod(int(flat), len(at))
        if not np.isfinite(cost[j, i]):
            break
        if i not in found and j not in used:
            found[i] = alive[j]
            used.add(j)
    return found


def _early_arrivals(images: list[_Image], way: Way, knots: F64, times: F64) -> Iterator[Arrivals]:
    """The early arrivals at each of ``times``; images that begin or end between two knots fade."""
    ears = way.listener.position_at(times)
    count = len(times)
    distance, weight = np.zeros((len(images), count)), np.zeros((len(images), count))
    offset, level = np.zeros((len(images), count, 3)), np.zeros((len(images), count, len(BANDS)))
    for number, image in enumerate(images):
        own = knots[image.first : image.last + 1]
        alive, gains = (own, np.ones(len(own)))
        if image.first > 0:
            alive, gains = np.insert(alive, 0, knots[image.first - 1]), np.insert(gains, 0, 0.0)
        if image.last + 1 < len(knots):
            alive, gains = np.append(alive, knots[image.last + 1]), np.append(gains, 0.0)
        weight[number] = np.interp(times, alive, gains, left=0.0, right=0.0)
        if image.first == 0:
            weight[number, times <= own[0]] = 1.0
        places, levels = np.array(image.places), np.array(image.levels)
        emitted = times
        for _ in range(_ROUNDS):
            if image.is_direct:
                place = way.source.position_at(emitted)
            else:
                place = np.stack([np.interp(emitted, own, axis) for axis in places.T], axis=-1)
            offset[number] = place - ears
            distance[number] = np.linalg.norm(offset[number], axis=-1)
            emitted = times - distance[number] / SPEED_OF_SOUND
        level[number] = np.stack([np.interp(emitted, own, band) for band in levels.T], axis=-1)
    for t in range(count):
        used = weight[:, t] > 0
        far = np.maximum(distance[used, t], 1e-9)
        pressure = level[used, t] * (weight[used, t] / np.maximum(far, 1e-3))[:, None]
        yield Arrivals(
            far / SPEED_OF_SOUND,
            (offset[used, t] / far[:, None]).astype(np.float32),
            pressure.astype(np.float32),
            np.ones(int(used.sum()), dtype=np.bool_),
        )


def _add_between(out: F64, signal: F64, responses: list[NDArray[np.float32]], span: tuple[int, int]) -> None:
    """Add the signal through two responses, the first fading into the second, to the samples of ``span``."""
    start, stop = span
    reach = max(one.shape[1] for one in responses)
    first = max(start - reach + 1, 0)
    piece = signal[first:stop]
    length = next_fast_len(len(piece) + reach, real=True)
    spectrum = rfft(piece, length)
    rise = (np.arange(stop - start) + 0.5) / (stop - start)
    for response, weight in zip(responses, (1.0 - rise, rise), strict=True):
        wet = irfft(spectrum * rfft(response.astype(np.float64), length, axis=1), length, axis=1)
        out[:, start:stop] += weight * wet[:, start - first : stop - first]
