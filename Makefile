PYTHON ?= python3
VENV ?= .venv

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

# Tests and benchmarks on the standard data sets run where the data sets are.
ifneq ($(wildcard ../shared/datasets),)
export SLAMCLI_DATASETS ?= $(abspath ../shared/datasets)
endif

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test lint format regress bench benchmarks docs datasets clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(VENV)/.stamp-run ## optimize a small pose graph and print the result
	@mkdir -p build
	@$(BIN)/slamcli optimize datasets/manhattan_small.g2o -o build/demo.g2o
	@echo "The optimized graph is in build/demo.g2o"

test: $(VENV)/.stamp-dev ## run the tests; ARGS="-k name" is passed to pytest
	$(BIN)/python -m pytest $(ARGS)

lint: $(VENV)/.stamp-dev ## check style, types and layering
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.stamp-dev ## format the code and mend what ruff can mend
	$(BIN)/ruff check --fix-only
	$(BIN)/ruff format

regress: $(VENV)/.stamp-run ## run the regression suites, that of the standard sets where they are
	$(BIN)/slamcli regress configs/suites/bundled.yaml $(ARGS)
ifneq ($(SLAMCLI_DATASETS),)
	$(BIN)/slamcli regress configs/suites/standard.yaml $(ARGS)
endif

bench: $(VENV)/.stamp-peers ## compare with other solvers; BENCH=optimum, certificate, ... picks a comparison
	$(BIN)/python -m benchmarks.$(or $(BENCH),run) $(ARGS)

benchmarks: $(VENV)/.stamp-peers ## measure docs/benchmarks.md anew (on an idle machine)
	$(BIN)/python -m benchmarks.publish $(ARGS)

docs: $(VENV)/.stamp-dev ## regenerate docs/cli.md
	$(BIN)/python docs/generate_cli.py

datasets: $(VENV)/.stamp-run ## regenerate the bundled data sets from configs/datasets
	@for file in manhattan_small.g2o sphere_small.g2o landmarks_small.g2o square_toro.graph; do \
	  name=$${file%.*}; \
	  $(BIN)/slamcli simulate configs/datasets/$$name.yaml --quiet -o datasets/$$file --truth datasets/truth/$$name.g2o || exit; \
	done

clean: ## remove the environment, build results and caches
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# One environment. A stamp says that a set of dependencies is installed as pyproject.toml has it.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "slamcli needs Python 3.11 or newer, and $(PYTHON) is not ($$($(PYTHON) --version 2>&1))." >&2; \
	  echo "Name another one: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.stamp-run: pyproject.toml | $(BIN)/python
	$(PIP) --editable .
	@touch $@

$(VENV)/.stamp-dev: $(VENV)/.stamp-run
	$(PIP) --editable '.[dev]'
	@touch $@

$(VENV)/.stamp-peers: $(VENV)/.stamp-run
	$(PIP) --editable '.[peers]'
	@touch $@
