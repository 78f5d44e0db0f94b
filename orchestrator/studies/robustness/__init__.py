"""Hard cases, and the same cases through other codes: nothing silently wrong."""
