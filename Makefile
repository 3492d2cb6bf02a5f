# `make bench` runs the benchmark, `make test` checks the code; both make the environment .venv first.
# Another interpreter: make PYTHON=/path/to/python3.11 ...

PYTHON ?= python3.11
SUITE ?= suites/pure_manip.yaml
# One more than cores: many tests wait for a process that they started.
PYTEST_WORKERS ?= $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)

SHELL := /bin/bash
VENV := .venv
BIN := $(VENV)/bin
PROJECTS := . $(patsubst %/pyproject.toml,%,$(wildcard plugins/*/pyproject.toml))

.DELETE_ON_ERROR:
.PHONY: help env bench test test-long speed clean

help:
	@echo 'make bench      run $(SUITE) and write its results (RUN_FLAGS="--tier smoke" for a first look)'
	@echo 'make test       ruff, mypy, lint-imports and the fast tests'
	@echo 'make test-long  the tests that take over a minute, or repeat the fast ones on other simulators'
	@echo 'make speed      every benchmarks/*_speed.py'
	@echo 'make env        only the environment, $(VENV), from requirements.lock'
	@echo 'make clean      remove $(VENV)'

env: $(VENV)/.installed

# A changed lock makes a new environment, so that nothing it no longer names is left behind.
$(VENV)/.locked: requirements.lock
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || { \
	  echo 'error: "$(PYTHON)" is not Python 3.11. Install it (Debian: apt-get install python3.11 python3.11-venv)' >&2; \
	  echo '       or name one: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)' >&2; exit 1; }
	"$(PYTHON)" -m venv --clear $(VENV)
	$(BIN)/python -m pip install --no-input --disable-pip-version-check --progress-bar off -r requirements.lock
	$(BIN)/python -m pip check
	@touch $@

$(VENV)/.installed: $(VENV)/.locked $(PROJECTS:%=%/pyproject.toml)
	$(BIN)/python -m pip install --no-input --disable-pip-version-check --quiet --no-deps $(PROJECTS:%=-e %)
	@touch $@

bench: env
	$(BIN)/causalbench run $(SUITE) $(RUN_FLAGS)

test: env
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -m 'not long' -n $(PYTEST_WORKERS) --dist worksteal

test-long: env
	$(BIN)/python -m pytest -m long

speed: env
	@set -e; found=; for script in benchmarks/*_speed.py; do \
	  [ -e "$$script" ] || continue; found=1; echo "== $$script"; $(BIN)/python "$$script"; \
	done; [ -n "$$found" ] || { echo 'error: no benchmarks/*_speed.py' >&2; exit 1; }

clean:
	rm -rf $(VENV)
