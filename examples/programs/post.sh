#!/bin/sh
# What the orchestrator starts: it is in an empty folder with springs.txt and forces.txt.
here=$(dirname "$(readlink -f "$0")")
exec FreeFem++ -nw -v 0 "$here/post.edp" "$here/${1:-post.mesh}"
