"""Constants of isotropic linear elasticity; codes in a Python of their own import this, so it needs numpy at most."""

from __future__ import annotations

import numpy as np


def lame(young: float | np.ndarray, poisson: float | np.ndarray) -> tuple[float | np.ndarray, float | np.ndarray]:
    """Lamé's λ = E ν / ((1 + ν)(1 − 2ν)) and μ = E / (2 (1 + ν)), each in the unit and shape of Young's modulus E.

    Examples
    --------
    >>> lame(1.0, 0.25)
    (0.4, 0.4)
    """
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
