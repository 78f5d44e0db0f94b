"""Wall time."""
