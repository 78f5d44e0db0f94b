"""What a subdomain is predicted to cost, and how many requests are to come."""

from __future__ import annotations

import numpy as np

# Measured growth with the number of dofs from 1,500 to 13,000, of factorisations (1.6) and back-substitutions (1.7).
EXPONENT = 1.6
# Linear stages expected of a run before it has begun (the shipped ones take 4 to 45).
STAGES = 20


def predicted_cost(dofs: np.ndarray) -> np.ndarray:
    """Factorisation and back-substitutions of subdomains with so many dofs; only ratios mean anything."""
    return np.asarray(dofs, float) ** EXPONENT
