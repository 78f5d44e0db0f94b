"""How many stages or sweeps runs need, and what the bound says of the true error."""
