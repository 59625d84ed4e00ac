# cosim: everything that one types. `run` and `test` set up the environment by themselves.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.set-up
JOBS ?= $(shell nproc 2>/dev/null || echo 2)
SOAK_SHARE ?= 1.0

# other interpreters than PYTHON, of which those are tried that are here
PYTHONS ?= python3.12 python3.13
TRIED := $(patsubst %,tests/test_%.py,cli experiment kernel randomness scenario settings simulation trace)

.PHONY: setup run sweep report test fast soak check pythons bench bench-peers docs fresh format clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,web,cluster,slurm,gym,sensitivity,docs,mcap]'
	$(BIN)/cosim warm
	touch $@

# a first look: the quick version of the main experiment, its table and figures
run: $(STAMP)
	$(BIN)/cosim sweep pseudonet_coverage --quick --jobs $(JOBS)
	$(BIN)/cosim report results/pseudonet_coverage-quick
	@echo
	@echo 'the command: . $(BIN)/activate, then cosim ...; or $(BIN)/cosim ...'

# make sweep E=messaging_delay
sweep: $(STAMP)
	@test -n "$(E)" || { echo "which experiment? make sweep E=NAME; cosim list names them"; exit 2; }
	$(BIN)/cosim sweep $(E) --jobs $(JOBS)
	$(BIN)/cosim report results/$(E)

# the fast and the slow tier
test: $(STAMP)
	$(BIN)/python -m pytest

fast: $(STAMP)
	$(BIN)/python -m pytest -m 'not slow and not soak'

# the long random campaigns, in full or (SOAK_SHARE=0.02) a seeded part of each
soak: $(STAMP)
	SOAK_SHARE=$(SOAK_SHARE) $(BIN)/python -m pytest -m soak -rP

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# fast tests of the command line and of what a run needs, and a run, on other interpreters
pythons:
	@for python in $(PYTHONS); do \
	    $$python -c '' 2>/dev/null || { echo "$$python is not here: nothing is tried with it"; continue; }; \
	    home=$(VENV)-$$($$python -c 'import sys; print("%d.%d" % sys.version_info[:2])'); \
	    $$python -m venv $$home && \
	    $$home/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,web,gym,sensitivity,mcap]' && \
	    $$home/bin/python -m pytest -q -m 'not slow and not soak' $(TRIED) && \
	    $$home/bin/cosim run examples/2_bluetooth.yaml || exit 1; \
	done

# the handbook, from docs/ and the code, into build/site/index.html; any warning is an error
docs: $(STAMP)
	$(BIN)/python -m sphinx -W -n --keep-going -q docs build/site

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(STAMP)
	$(BIN)/python -m benchmarks
	$(BIN)/python -m benchmarks.sweeps
	$(BIN)/python -m benchmarks.keeping

# the same work for ns-3, IR-SIM, GrADyS-SIM and us; make bench-peers WRITE=1 keeps the table in benchmarks/README.md
bench-peers: $(STAMP)
	$(BIN)/python -m benchmarks.peers $(if $(WRITE),--write)

# what README.md tells, line by line, in a fresh clone of HEAD and then with the wheel; make fresh ALL=1: what takes long too
fresh:
	$(PYTHON) tests/fresh.py $(if $(ALL),--all)

clean:
	rm -rf $(VENV) $(VENV)-* .pytest_cache .mypy_cache .ruff_cache .hypothesis build *.egg-info
