"""Wall time: of whole runs, against the error, over workers and ranks, of large problems."""
