"""Workers, their processes and files: started, kept busy, ended."""
