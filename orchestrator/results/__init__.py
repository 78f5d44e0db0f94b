"""Results of a run: subscribers to its events, fields, summary, figures, report."""
