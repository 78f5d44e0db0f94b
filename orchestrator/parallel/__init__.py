"""Ranks: placing subdomains, exchange, sums; and the single process as one of them."""
