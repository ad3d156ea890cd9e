"""Published colours of the 24 patches of the ColorChecker chart, for finding it in photographs and for drawing it.

McCamy, Marcus and Davidson 1976, "A Color-Rendition Chart", Journal of Applied Photographic Engineering 2(3), 95-99:
CIE 1931 xyY of every patch under illuminant C. Made linear sRGB here (IEC 61966-2-1) after Bradford adaptation to D65.
"""

import numpy as np

from crfbench.curves import Array

# x, y, Y with Y = 1 for a perfect reflector, in chart order (row by row from dark skin to black).
_XYY: Array = np.array(
    [
        [(0.4002, 0.3504, 0.1005), (0.3773, 0.3446, 0.3582), (0.2470, 0.2514, 0.1933)],
        [(0.3372, 0.4220, 0.1329), (0.2651, 0.2400, 0.2427), (0.2608, 0.3430, 0.4306)],
        [(0.5060, 0.4070, 0.3005), (0.2110, 0.1750, 0.1200), (0.4533, 0.3058, 0.1977)],
        [(0.2845, 0.2020, 0.0656), (0.3800, 0.4887, 0.4429), (0.4729, 0.4375, 0.4306)],
        [(0.1866, 0.1285, 0.0611), (0.3046, 0.4782, 0.2339), (0.5385, 0.3129, 0.1200)],
        [(0.4480, 0.4703, 0.5910), (0.3635, 0.2325, 0.1977), (0.1958, 0.2519, 0.1977)],
        [(0.3101, 0.3163, 0.9001), (0.3101, 0.3163, 0.5910), (0.3101, 0.3163, 0.3620)],
        [(0.3101, 0.3163, 0.1977), (0.3101, 0.3163, 0.0900), (0.3101, 0.3163, 0.0313)],
    ]
).reshape(-1, 3)
_WHITE_C, _WHITE_D65 = (0.31006, 0.31616), (0.3127, 0.3290)
_BRADFORD: Array = np.array([(0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296)])
_XYZ_TO_SRGB: Array = np.array([(3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570)])


def chart_colours() -> Array:
    """Return linear sRGB of the 24 patches in chart order, shape (24, 3); 1 is a perfect reflector.

    The red of the cyan patch lies outside sRGB and is negative.
    """
    sharpened = _xyz(_XYY) @ _BRADFORD.T
    white_c, white_d65 = (_xyz(np.array([*white, 1.0])) @ _BRADFORD.T for white in (_WHITE_C, _WHITE_D65))
    adapted = sharpened * (white_d65 / white_c) @ np.linalg.inv(_BRADFORD).T
    return adapted @ _XYZ_TO_SRGB.T


def _xyz(xyy: Array) -> Array:
    x, y, luminance = np.moveaxis(xyy, -1, 0)
    return np.stack([x, y, 1.0 - x - y], axis=-1) * (luminance / y)[..., None]
