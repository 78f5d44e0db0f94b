"""One configuration, run with different values: `orchestrator sweep`."""
