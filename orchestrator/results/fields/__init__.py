"""Fields on disk: what is in the files, under which names, written and read back."""
