"""Problems that studies share."""
