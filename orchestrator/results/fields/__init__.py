"""Fields on disk, and the stresses in them."""
