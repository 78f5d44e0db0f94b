"""Studies that stand beside the package: trials of it from outside, through its public face."""
