"""CalculiX as a black box: unmodified, one run per question, input decks in and files out."""
