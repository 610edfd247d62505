# `make run` sets everything up and runs the main job, `make test` sets everything up and runs the tests.
# `make help` lists all targets.

VENV ?= .venv
PYTHON ?= python3
BIN := $(VENV)/bin
UV := $(shell command -v uv 2>/dev/null)

# An installer that writes bytecode while it installs, so that the first start is not slower than the next ones.
ifeq ($(UV),)
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
else
INSTALL = $(UV) pip install --quiet --compile-bytecode --python $(BIN)/python -c constraints.txt
endif

PYTEST = $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

.PHONY: help run run-all example evidence check test test-all test-long lint docs notebooks package everywhere fuzz soak mutations mutants report licences graphics clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' Makefile | sed 's/:.*## /\t/' | sort | awk -F'\t' '{printf "  make %-12s %s\n", $$1, $$2}'

run: $(VENV)/ready graphics ## set everything up and build the shipped stimuli into out/
	@$(BIN)/stepblocks build

run-all: run $(VENV)/ready-all ## everything that the program can make: drawings, scenes, a session, evidence
	$(BIN)/stepblocks workshop
	$(BIN)/stepblocks feel --no-open
	$(MAKE) --no-print-directory example
	$(MAKE) --no-print-directory evidence
	for name in mujoco chai3d sofa usd gltf x3d forcelaw native; do $(BIN)/stepblocks export --for $$name --quiet || exit 1; done
	$(BIN)/stepblocks build

test: $(VENV)/ready-dev graphics ## the tests of every room and every promise, in minutes
	$(PYTEST)

test-all: test test-long ## all tests, and the examples of docstrings

test-long: $(VENV)/ready-dev graphics ## what `make test` leaves out: many seeds, formats, engines, examples; and those of docstrings
	$(PYTEST) -m "long or hypothesis"
	$(BIN)/python -m pytest --doctest-modules src/stepblocks

check: $(VENV)/ready-dev ## lint, types, and the quick tests of the rooms that the working tree changed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python benchmarks/changed_rooms.py

lint: $(VENV)/ready-dev ## style, types and import rules
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/win32
	$(BIN)/mypy --platform darwin --cache-dir .mypy_cache/darwin
	$(BIN)/python benchmarks/page_types.py
	$(BIN)/lint-imports

docs: $(VENV)/ready-dev ## the site of the documentation, in out/site; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo open out/site/index.html

notebooks: $(VENV)/ready-dev graphics ## run the tutorials as notebooks from empty folders, into out/tutorials
	$(BIN)/python benchmarks/notebooks.py

# The wheel is built twice and must have the same bytes. It is installed by itself and used from an
# empty folder outside the checkout.
package: export SOURCE_DATE_EPOCH = $(shell git log -1 --format=%ct 2>/dev/null || echo 1700000000)
package: $(VENV)/ready-dev ## wheel, sdist and a bill of materials, tried outside the checkout
	rm -rf dist build $(VENV)-package && mkdir -p dist/again
	$(BIN)/python -c 'import setuptools.build_meta as b; b.build_wheel("dist/again")'
	rm -rf build
	$(BIN)/python -c 'import setuptools.build_meta as b; b.build_sdist("dist"); b.build_wheel("dist")'
	cmp dist/*.whl dist/again/*.whl && rm -r dist/again
	$(PYTHON) -m venv $(VENV)-package
	$(VENV)-package/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt dist/*.whl
	wheel=$$(echo dist/*.whl) && $(VENV)-package/bin/python benchmarks/bill_of_materials.py $${wheel%.whl}.cdx.json
	here=$$(cd $(VENV)-package/bin && pwd) && cd "$$(mktemp -d)" && "$$here/stepblocks" new block mine.toml \
	  && "$$here/stepblocks" build mine.toml && "$$here/stepblocks" check mine.toml --quiet

example: $(VENV)/ready ## simulate a session with an effect that it does not declare, and run the loop on it
	rm -rf out/session
	$(BIN)/stepblocks simulate-session examples/undeclared.toml -o out/session
	$(BIN)/stepblocks loop out/session -o out/loop

evidence: $(VENV)/ready ## published figures beside what the model says of them, in out/evidence
	PYTHONPATH=benchmarks $(BIN)/python -m literature out/evidence

# `make everywhere STAGES=Nehalem` runs some.
everywhere: $(VENV)/ready-dev graphics ## the tests under other processors, threads, Pythons and library versions
	$(BIN)/python benchmarks/everywhere.py $(STAGES)

fuzz: $(VENV)/ready-dev graphics ## feed strange files to every reader, and inject faults at every point of writing
	$(BIN)/python benchmarks/fuzz.py
	$(BIN)/python benchmarks/faults.py

soak: $(VENV)/ready-dev graphics ## two users for an hour in one folder, while the disk fills and the clock jumps
	$(BIN)/python benchmarks/soak.py

# A run can be interrupted: the record in out/ keeps what is done.
mutations: $(VENV)/ready-dev graphics ## put small mistakes into a copy of the core, and see whether the tests notice
	$(BIN)/python benchmarks/mutations.py

# Of those that the tests decide in time, at most three in ten may survive: where nine in ten are noticed, at most one
# day in fifty fails by chance.
mutants: $(VENV)/ready-dev graphics ## twenty small mistakes, others on every day, in five minutes
	$(BIN)/python benchmarks/mutations.py --sample 20 --seed "$$(date +%Y%m%d)" --seconds 300 --survivors 0.3

# `make report PARTS="scans drag-paper"` measures some. Records go to docs/records.
report: $(VENV)/ready-all $(VENV)/ready-dev graphics ## measure the figures that the docs quote again (hours)
	$(BIN)/python benchmarks/report.py $(PARTS)

licences: $(VENV)/ready-dev ## the licences of all dependencies
	$(BIN)/python benchmarks/licences.py

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "stepblocks needs Python 3.11 or newer")'
	@echo 'installing into $(VENV): a minute or two'
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e .
	@$(BIN)/python -m compileall -q src
	@touch $@

$(VENV)/ready-all: $(VENV)/ready
	$(INSTALL) -e '.[sim,sweep]'
	@touch $@

$(VENV)/ready-dev: $(VENV)/ready
	$(INSTALL) -e '.[dev]'
	@$(BIN)/python benchmarks/compile_kernels.py
	@touch $@

# The CAD kernel and the renderer load OpenGL from the system, even without a screen.
graphics: ## the libraries of OpenGL, where they are missing
	@[ "$$(uname)" != Linux ] || $(PYTHON) -c 'import ctypes; ctypes.CDLL("libGL.so.1"); ctypes.CDLL("libEGL.so.1")' 2>/dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt-get update -qq \
	       && apt-get install -y -qq libgl1 libegl1 libgl1-mesa-dri libxrender1 >/dev/null; } \
	  || { echo 'OpenGL is missing: install libGL and libEGL, on Debian: apt-get install libgl1 libegl1 libgl1-mesa-dri' >&2; exit 1; }

clean: ## remove environments and built packages
	rm -rf $(VENV) $(VENV)-package build dist *.egg-info src/*.egg-info
