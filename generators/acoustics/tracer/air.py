"""Absorption of sound in air after ISO 9613-1:1993."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.acoustics.tracer.arrivals import BANDS

#: Air of a dwelling: temperature (°C), relative humidity (%), pressure (kPa).
TEMPERATURE, HUMIDITY, PRESSURE = 20.0, 50.0, 101.325
#: Reference pressure (kPa), reference temperature and triple point of water (K) of the standard.
_P0, _T0, _T01 = 101.325, 293.15, 273.16


def attenuation_db(
    frequency: ArrayLike,
    temperature: float = TEMPERATURE,
    humidity: float = HUMIDITY,
    pressure: float = PRESSURE,
) -> NDArray[np.float64]:
    """Attenuation of a pure tone in dB per metre: equations (3) to (5) and (B.2), (B.3) of the standard.

    Args:
        frequency: Hz, any shape.
        temperature: °C.
        humidity: relative humidity, %.
        pressure: kPa.
    """
    f = np.asarray(frequency, dtype=np.float64)
    kelvin = temperature + 273.15
    relative, ratio = kelvin / _T0, pressure / _P0
    saturation = 10 ** (-6.8346 * (_T01 / kelvin) ** 1.261 + 4.6151)
    vapour = humidity * saturation / ratio  # molar concentration, %
    oxygen = ratio * (24 + 4.04e4 * vapour * (0.02 + vapour) / (0.391 + vapour))
    nitrogen = ratio * relative**-0.5 * (9 + 280 * vapour * math.exp(-4.170 * (relative ** (-1 / 3) - 1)))
    classical = 1.84e-11 / ratio * relative**0.5
    relaxation = relative**-2.5 * (
        0.01275 * math.exp(-2239.1 / kelvin) / (oxygen + f * f / oxygen)
        + 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen + f * f / nitrogen)
    )
    return np.asarray(8.686 * f * f * (classical + relaxation))


def energy_exponents() -> NDArray[np.float64]:
    """(8,) m in 1/m per octave of `BANDS`: the energy of a wave falls as exp(−m·x)."""
    return attenuation_db(BANDS) * math.log(10) / 10
