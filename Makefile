# Everything here sets up what it needs: a virtual environment in .venv with the pinned dependencies. The demo
# needs few of them, compiles what it needs itself and so starts sooner; the tests need all.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
READY := $(VENV)/.ready
COMPILED := $(VENV)/.compiled
READY_DEV := $(VENV)/.ready-dev

.PHONY: demo test lint bench clean

demo: $(READY)  ## fly the simulated formation, with a live view where there is a display
	$(BIN)/onboard demo $(ARGS)

test: $(READY_DEV) $(COMPILED) lint  ## everything CI runs
	$(BIN)/python -m pytest -n 2 --dist loadfile $(ARGS)

lint: $(READY_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(READY_DEV) $(COMPILED)
	$(BIN)/python -m benchmarks --json bench.json

clean:
	rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .hypothesis

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "this needs Python 3.11 or newer")'
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "on Debian and Ubuntu: apt install python3-venv"; exit 1; }

$(READY): $(VENV)/bin/python pyproject.toml constraints.txt
	@echo "installing into $(VENV) (about a minute, once)"
	$(INSTALL) -e '.[view]'
	@touch $@

$(READY_DEV): $(READY)
	@echo "installing what the tests need (about a minute, once)"
	$(INSTALL) -e '.[view,study,dev]'
	@touch $@

$(COMPILED): $(READY) $(wildcard onboard/filters/*.py onboard/filters/kernels/*.py onboard/geometry/*.py onboard/models/*.py onboard/estimators/*/*.py)
	$(BIN)/onboard compile
	@touch $@
