"""Several independent two-state Markov chains at once: sources that start and stop; forward and backward algorithms."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Array = NDArray[np.float64]


class Chains:
    """``count`` sources, each off or on, with the same probabilities of starting and stopping between two frames.

    Attributes:
        states: the 2^count joint states, each a tuple of bool; the first is all off.
    """

    def __init__(self, count: int, on: float, off: float) -> None:
        """Make the joint chain.

        Args:
            count: number of sources.
            on: probability that a source that is off starts.
            off: probability that a source that is on stops.
        """
        self.states = tuple(product((False, True), repeat=count))
        step, start = np.ones((1, 1)), np.ones(1)
        for _ in range(count):
            step = np.kron(step, np.array([[1 - on, on], [off, 1 - off]]))
            start = np.kron(start, np.array([0.5, 0.5]))
        self._step, self._start = step, start

    def evidence(self, emission: Array) -> Array:
        """(H,) log-probability of all frames, given log-likelihoods (T, states, H) under each of H hypotheses."""
        return np.asarray(self._forward(emission)[1])

    def _forward(self, emission: Array) -> tuple[Array, Array]:
        """(T, states, H) filtered probabilities, and (H,) log-probability of all frames."""
        highest = emission.max(axis=1, keepdims=True)
        likelihood = np.exp(emission - highest)
        out = np.empty_like(likelihood)
        total = highest.sum(axis=(0, 1))
        state = np.repeat(self._start[:, None], emission.shape[2], axis=1)
        for t, frame in enumerate(likelihood):
            state = (state if t == 0 else self._step.T @ state) * frame
            norm = np.maximum(state.sum(axis=0), np.finfo(float).tiny)
            state = state / norm
            total = total + np.log(norm)
            out[t] = state
        return out, total

    def posterior(self, emission: Array) -> Array:
        """(T, states) probability of each joint state, given log-likelihoods (T, states) of all frames."""
        filtered = self._forward(emission[:, :, None])[0][:, :, 0]
        likelihood = np.exp(emission - logsumexp(emission, axis=1, keepdims=True))
        later = np.ones(len(self.states))
        out = np.empty_like(filtered)
        for t in range(len(emission) - 1, -1, -1):
            joint = filtered[t] * later
            out[t] = joint / joint.sum()
            later = self._step @ (likelihood[t] * later)
            later /= later.sum()
        return out
