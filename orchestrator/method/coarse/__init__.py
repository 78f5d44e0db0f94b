"""The coarse contact problem: every body moves in its affine fields under the true laws."""
