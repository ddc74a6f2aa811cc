# make demo: train, evaluate, plan, draw and execute.   make test: lint, types and tests.   make lint: the first two.
# Each installs everything in .venv first, the simulator included.
VENV := .venv
PYTHON ?= python3
BIN := $(VENV)/bin
# Overrides of the demo's training, and how many instances it evaluates.
DEMO_TRAIN ?=
DEMO_LIMIT ?= 1000

.PHONY: demo test test-slow lint bench venv clean

demo: venv
	BIN=$(BIN) LIMIT=$(DEMO_LIMIT) scripts/demo.sh $(DEMO_TRAIN)

# Two processes of one thread each: threads wait for each other on busy cores.
test: lint
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow and not gpu"

test-slow: venv
	$(BIN)/python -m pytest -m "slow"

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: venv
	$(BIN)/python -m scripts.bench_world out=outputs/world
	$(BIN)/dore-report study=world

venv: $(VENV)/.installed

# The stamp comes last, so that an interrupted installation is repeated.
$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable ".[sim,jaco,dev]"
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info
