"""Other solvers on the same matrix, each in processes of its own; what is not installed is left out by name."""
