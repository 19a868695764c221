"""Colour measures: sRGB, luminance, CIELAB and the colour difference CIEDE2000.

Pictures are arrays whose last axis is R, G, B; sRGB values and linear values lie in [0, 1].
"""
from __future__ import annotations

import numpy as np

#: Rec. 709 luminance of linear R, G, B.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
#: CIE XYZ from linear Rec. 709 / sRGB (ITU-R BT.709 primaries, white D65).
XYZ_FROM_RGB = np.array([[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]])
#: D65, 2 degree observer.
WHITE = np.array([0.95047, 1.0, 1.08883])


def linear_from_srgb(encoded: np.ndarray) -> np.ndarray:
    """Inverse of the sRGB transfer function (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """sRGB transfer function (IEC 61966-2-1); values outside [0, 1] are clipped."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def luminance(encoded: np.ndarray) -> np.ndarray:
    """Linear luminance of sRGB values."""
    return linear_from_srgb(encoded) @ LUMINANCE


def lab_from_srgb(encoded: np.ndarray) -> np.ndarray:
    """CIELAB (1976) of sRGB values, white D65."""
    relative = linear_from_srgb(encoded) @ XYZ_FROM_RGB.T / WHITE
    root = np.where(relative > (6 / 29) ** 3, np.cbrt(relative), relative / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)


def ciede2000(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """CIEDE2000 difference of CIELAB colours, parametric factors 1.

    Names and order of steps follow Sharma, Wu and Dalal (2005), whose test pairs the function reproduces.
    """
    L1, a1, b1 = np.moveaxis(np.asarray(first, float), -1, 0)
    L2, a2, b2 = np.moveaxis(np.asarray(second, float), -1, 0)
    G = 0.5 * (1 - _chroma_weight((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2))
    C1, h1 = _polar((1 + G) * a1, b1)
    C2, h2 = _polar((1 + G) * a2, b2)
    grey = C1 * C2 == 0
    dh, h = _hues(h1, h2, grey)
    dL, dC, dH = L2 - L1, C2 - C1, 2 * np.sqrt(C1 * C2) * _sin(dh / 2)
    L, C = (L1 + L2) / 2, (C1 + C2) / 2
    T = 1 - 0.17 * _cos(h - 30) + 0.24 * _cos(2 * h) + 0.32 * _cos(3 * h + 6) - 0.20 * _cos(4 * h - 63)
    SL = 1 + 0.015 * (L - 50) ** 2 / np.sqrt(20 + (L - 50) ** 2)
    SC, SH = 1 + 0.045 * C, 1 + 0.015 * C * T
    RT = -_sin(60 * np.exp(-(((h - 275) / 25) ** 2))) * 2 * _chroma_weight(C)
    lightness, chroma, hue = dL / SL, dC / SC, dH / SH
    return np.sqrt(lightness**2 + chroma**2 + hue**2 + RT * chroma * hue)


def _chroma_weight(chroma: np.ndarray) -> np.ndarray:
    """sqrt(C^7 / (C^7 + 25^7))."""
    return np.sqrt(chroma**7 / (chroma**7 + 25.0**7))


def _polar(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chroma, and hue in degrees within [0, 360)."""
    return np.hypot(a, b), np.degrees(np.arctan2(b, a)) % 360


def _hues(h1: np.ndarray, h2: np.ndarray, grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Difference and mean of two hues in degrees along the shorter arc; a grey has no hue."""
    far = np.abs(h2 - h1) > 180
    turn = np.where(h2 > h1, 360, -360)
    difference = np.where(grey, 0.0, h2 - h1 - far * turn)
    total = h1 + h2
    mean = (total + far * np.where(total < 360, 360, -360)) / 2
    return difference, np.where(grey, total, mean)


def _sin(degrees: np.ndarray) -> np.ndarray:
    return np.sin(np.radians(degrees))


def _cos(degrees: np.ndarray) -> np.ndarray:
    return np.cos(np.radians(degrees))
