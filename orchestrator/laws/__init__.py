"""Interface laws, one module each: parameters, force, residuals, statuses; ``registry.LAWS`` finds them by name.

A law answers one question, pointwise and vectorised over all node pairs that share it: given the
predicted force F on side 1, which force f̂ does the interface carry? The jump follows from the
search direction, d = (F − f̂)/keq.
"""
