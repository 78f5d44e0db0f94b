"""Is a code fit to take part? Checks against the protocol."""
