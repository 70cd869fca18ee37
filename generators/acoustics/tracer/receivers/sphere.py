"""Sound pressure on a rigid sphere, from any distance: the exact head-related transfer function of a spherical head.

Time dependence exp(+iωt): a delay τ is exp(−iωτ). θ is the angle between the point on the sphere and the direction the
sound comes from. The pressure is given relative to that of the free field at the sphere's centre.

References:
    Lord Rayleigh, A. Lodge, "On the acoustic shadow of a sphere", Phil. Trans. R. Soc. A 203 (1904) 87–110.
    R. O. Duda, W. L. Martens, "Range dependence of the response of a spherical head model", JASA 104 (1998) 3048–3058,
    eq. (3), and eq. (4) for a source at infinity.
    G. F. Kuhn, "Model for the interaural time differences in the azimuthal plane", JASA 62 (1977) 157–167: the ITD is
    3·(a/c)·sin φ at low frequencies and Woodworth's (a/c)·(φ + sin φ) at high ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import eval_legendre, spherical_jn, spherical_yn

C128 = NDArray[np.complex128]
F64 = NDArray[np.float64]

#: Terms of the series beyond ka; the next ones are below 1e-9 of the sum.
_MORE_TERMS = 16
#: Size of the first term of a near source's series that is left out: its terms fall by the nearness each.
_LEAST_TERM = 1e-6


def sphere_coefficients(ka: ArrayLike, nearness: float = 0.0) -> C128:
    """(M, K) coefficients bₘ(ka) of the pressure on the sphere, p(θ) = Σ (2m + 1)·bₘ·Pₘ(cos θ).

    bₘ = iᵐ·(−i/(ka)²)/h′ₘ(ka) for a plane wave, with the spherical Hankel function of the second kind; bₘ(0) = 1 for
    m = 0, else 0. For a point source at the distance r, bₘ = −(r/a)/(ka)·exp(ikr)·hₘ(kr)/h′ₘ(ka).

    Args:
        ka: (K,) wave number times radius, at least 0; above 0 for a near source.
        nearness: radius over the source's distance, a/r, below 1; 0 for a plane wave.
    """
    x = np.asarray(ka, dtype=np.float64)
    more = _MORE_TERMS if nearness <= 0 else max(_MORE_TERMS, int(np.ceil(np.log(_LEAST_TERM) / np.log(nearness))))
    orders = np.arange(int(np.ceil(x.max(initial=0.0) * 1.1)) + more)[:, None]
    safe = np.where(x > 0, x, 1.0)[None, :]
    # High orders at low frequencies overflow to infinity, which makes the coefficient 0, as it should be.
    with np.errstate(over="ignore", invalid="ignore"):
        slope = spherical_jn(orders, safe, derivative=True) - 1j * spherical_yn(orders, safe, derivative=True)
        if nearness > 0:
            far = safe / nearness
            wave = spherical_jn(orders, far) - 1j * spherical_yn(orders, far)
            found = -np.exp(1j * far) / (nearness * safe) * wave / slope
        else:
            found = (-1j / safe**2) / slope * 1j ** (orders % 4)
    # NaN: the derivative of y is the difference of two infinities.
    found = np.where(np.isfinite(found), found, 0.0)
    return np.asarray(np.where(x[None, :] > 0, found, (orders == 0).astype(np.complex128)))


def sphere_response(theta: ArrayLike, ka: ArrayLike, nearness: float = 0.0) -> C128:
    """(T, K) pressure on the sphere at incidence angles ``theta`` (T,) in radians for ``ka`` (K,).

    ``nearness`` is that of `sphere_coefficients`.
    """
    coefficients = sphere_coefficients(ka, nearness)
    orders = np.arange(len(coefficients))
    cosine = np.cos(np.asarray(theta, dtype=np.float64))
    legendre = eval_legendre(orders[None, :], cosine[:, None])
    # Not the product of BLAS, whose last bits depend on the processor and on the number of threads.
    return np.asarray(np.einsum("tm,mk->tk", legendre * (2 * orders + 1), coefficients))


def diffuse_coherence(ka: ArrayLike, between: float = np.pi) -> F64:
    """(K,) coherence of the pressures at two points of the sphere in a diffuse field; real by symmetry.

    Σ (2m + 1)·|bₘ|²·Pₘ(cos γ) / Σ (2m + 1)·|bₘ|², from the addition theorem of spherical harmonics.

    Args:
        ka: (K,) wave number times radius.
        between: angle γ between the two points as seen from the centre, radians.
    """
    power = np.abs(sphere_coefficients(ka)) ** 2
    orders = np.arange(len(power))
    weighted = (2 * orders + 1)[:, None] * power
    return np.asarray((eval_legendre(orders, np.cos(between))[:, None] * weighted).sum(axis=0) / weighted.sum(axis=0))
