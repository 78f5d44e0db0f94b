# make: the targets. Everything else sets up first what is missing; a second call sets up nothing.

.PHONY: help setup setup-tests run test test-all docs rivals cluster clean
.DEFAULT_GOAL := help

CONFIG ?= configs/traction_beam.yaml

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup:  ## FreeFEM, OpenBLAS, X libraries (Debian packages) and a virtual environment in .venv
	@./setup.sh

setup-tests:
	@./setup.sh tests

run:  ## set up what a run needs, solve CONFIG (configs/traction_beam.yaml), print the summary and where the figures are
	@./setup.sh run
	@.venv/bin/orchestrator run $(CONFIG)

test: setup-tests  ## set up CalculiX too, run the tests in three processes
	@.venv/bin/python -m pytest -q -n 3 --dist loadgroup -m "not long"

test-all: setup-tests cluster  ## the same with the tests that take long: studies in small, a CAD assembly read anew
	@.venv/bin/python -m pytest -q -n 3 --dist loadgroup

docs: setup-tests  ## make pages of docs/ in site/, with a search that needs no network
	@.venv/bin/python -m sphinx -q -W docs site
	@echo site/index.html

rivals:  ## set up PETSc, pyamg and PARDISO too, which `orchestrator study large` compares with
	@./setup.sh rivals

cluster:  ## set up .venv-cluster too, Debian's Python with its PETSc and MPI, for runs over many ranks
	@./setup.sh cluster

clean:  ## remove results, pages, caches and the virtual environment
	@rm -rf .venv .venv-cluster results site *.egg-info .pytest_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
