"""FreeFEM as a black box: a script of its own that answers as long as it is asked."""
