# All that a newcomer has to know: make demo, make test, make docs, make bench.
SHELL := /bin/bash
PYTHON := /usr/bin/python3
ENV := source tools/env.bash

MINUTES := 10
JOBS := 2
SECONDS := 60

# Nodes start a thousand times in a test run: what Python has compiled is kept.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help setup build sshd compiled prepared test test-long fuzz coverage mutation reliability redteam demo hosts-demo docs deb bench clean

help:
	@echo "make demo    run the paper's demonstration; see results/demo/"
	@echo "make hosts-demo   the same on three computers, made of this machine's namespaces; see results/hosts_demo/"
	@echo "make test    JOBS=2: run every test, so many robots at once"
	@echo "make test-long   the same with five times as many random cases, and more trials on robots"
	@echo "make docs    the documentation as a site (Debian 12); see build/docs/index.html"
	@echo "make deb     Debian packages for the ROS of this system; see build/deb/"
	@echo "make bench   measure; see results/bench/"
	@echo "make fuzz    MINUTES=10: look for inputs that break a reader; those found are tested from then on"
	@echo "make coverage, make mutation   how well the core is tested; see CONTRIBUTING.md"
	@echo "make reliability   try every fault of the fault model, again and again; see docs/explanation/faults.md"
	@echo "make redteam   SECONDS=60: attack a live robot as another user; see docs/howto/secure.md"
	@echo "make build   set up and build only"
	@echo "make clean   delete what was built"

setup:
	@tools/setup

# Told nothing, catkin_make has make run one job at a time for as long as the load was high before.
build: setup
	@echo "[build] building the workspace"
	@$(ENV) && MAKEFLAGS=-j$(shell nproc) catkin_make --source . -DPYTHON_EXECUTABLE=$(PYTHON) -DCMAKE_BUILD_TYPE=Release

# Where none can be fetched, what needs it says so.
sshd: setup
	@tools/fetch_sshd || true

# CMake leaves a processor idle, and each worker of pytest would compile for itself.
prepared:
	@$(MAKE) --no-print-directory -j 3 build sshd compiled

# Imports fail before the build: each file of tests is compiled by then, with what its asserts say.
compiled: setup
	@$(PYTHON) -m compileall -q src/*/src
	@$(PYTHON) -m pytest -q --collect-only --tb=no -p no:cacheprovider > /dev/null 2>&1 || true

# See conftest.py for their order, what stays together, and what the last worker runs.
WORKERS = $(shell expr $(JOBS) + 1)

test: prepared
	@$(ENV) && $(PYTHON) -m pytest -n $(WORKERS)

# With every random case; see shsa_testing/thorough.py.
test-long: prepared
	@$(ENV) && SHSA_LONG=1 $(PYTHON) -m pytest -n $(WORKERS)

fuzz: build
	@tools/fuzz $(MINUTES)

coverage: build
	@$(ENV) && SHSA_LONG=1 $(PYTHON) -m pytest -q src/shsa_core/test/unit src/shsa_gate/test/unit src/shsa_learning/test/unit --cov --cov-report=term

mutation: build
	@$(ENV) && SHSA_LONG=1 tools/mutation

reliability: build
	@$(ENV) && tools/reliability

redteam: build
	@$(ENV) && tools/redteam --seconds $(SECONDS)

demo: build
	@$(ENV) && rosrun shsa_rover demo --results results/demo

hosts-demo: build sshd
	@$(ENV) && rosrun shsa_rover hosts_demo --results results/hosts_demo

docs: build
	@$(PYTHON) -c "import myst_parser, sphinx_rtd_theme" || \
	  { echo "make docs needs python3-myst-parser and python3-sphinx-rtd-theme: Debian 12 has both, Ubuntu 20.04 only the theme" >&2; exit 1; }
	@rm -rf build/docs
	@$(ENV) && $(PYTHON) -m sphinx -W --keep-going -n -q -E -c docs -d build/docs-cache . build/docs
	@echo "[docs] $(CURDIR)/build/docs/index.html"

deb: setup
	@$(PYTHON) tools/deb

bench: build
	@$(ENV) && tools/bench

clean:
	rm -rf build devel install results .catkin_workspace
