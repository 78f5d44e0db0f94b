"""Two results folders beside each other: what of them differs, and by how much."""
