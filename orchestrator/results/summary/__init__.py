"""summary.json and what goes into it."""
