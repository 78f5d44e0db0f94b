"""The multiscale LATIN method: linear stage, local stage, coarse contact problem, acceleration, stopping, delivery."""
