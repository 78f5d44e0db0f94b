"""What a run leaves behind: subscribers to its events, fields, summary, figures, report."""
