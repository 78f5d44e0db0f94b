"""Problems and settings that several studies share, as plain data."""
