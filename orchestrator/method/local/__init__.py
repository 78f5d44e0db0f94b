"""The local stage: the laws, and the exchange of perfect interfaces."""
