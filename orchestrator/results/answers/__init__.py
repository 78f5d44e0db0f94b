"""What is asked of a solution: extremes, probes, resultants, work."""
