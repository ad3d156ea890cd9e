"""What a response is, as tests ask it."""

import numpy as np


def off_endpoints(curves: np.ndarray, tolerance: float = 1e-6) -> np.ndarray:
    """Say of each curve, (1024,) or (n, 1024), whether it misses (0, 0) or (1, 1); printed curves have six digits."""
    return np.abs(np.atleast_2d(curves)[:, [0, -1]] - (0.0, 1.0)).max(axis=-1) > tolerance
