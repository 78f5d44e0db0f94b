"""Shares of the largest of their kind below which numbers say nothing.

A length below ``WRITTEN`` of the whole may come of the digits that files have; one below
``PLACED`` comes of turning, projecting and measuring what is exact; a difference below ``SAME``
comes of some sums and products in double precision.
"""

WRITTEN = 1e-6  # files have six digits, or more
PLACED = 1e-9  # roots of double precision's eps, times what projections lose
SAME = 1e-12  # some thousand eps
