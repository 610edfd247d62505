# `make run` sets everything up and runs the main job, `make test` sets everything up and runs the tests.

VENV ?= .venv
PYTHON ?= python3
BIN := $(VENV)/bin

.PHONY: run run-all example evidence test lint docs notebooks package everywhere fuzz soak mutations report licences graphics clean

run: $(VENV)/ready graphics
	@$(BIN)/stepblocks build

# All that the program makes: build, drawings, page to feel, a simulated session, evidence,
# and the scene of every simulator.
run-all: run $(VENV)/ready-all
	$(BIN)/stepblocks workshop
	$(BIN)/stepblocks feel --no-open
	$(MAKE) --no-print-directory example
	$(MAKE) --no-print-directory evidence
	for name in mujoco chai3d sofa usd gltf x3d forcelaw native; do $(BIN)/stepblocks export --for $$name --quiet || exit 1; done
	$(BIN)/stepblocks build

# The site of the documentation, in out/site; a warning is an error.
docs: $(VENV)/ready-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo open out/site/index.html

# Run the tutorials as notebooks from empty folders; the result is in out/tutorials.
notebooks: $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/notebooks.py

# Wheel, sdist and a bill of materials. The wheel is built twice and must have the same bytes. It is
# installed by itself and used from an empty folder outside the checkout.
package: export SOURCE_DATE_EPOCH = $(shell git log -1 --format=%ct 2>/dev/null || echo 1700000000)
package: $(VENV)/ready-dev
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

# Simulate a session with an effect that it does not declare, and run the loop on it.
example: $(VENV)/ready
	rm -rf out/session
	$(BIN)/stepblocks simulate-session examples/undeclared.toml -o out/session
	$(BIN)/stepblocks loop out/session -o out/loop

# Published figures beside what the model says of them, in out/evidence.
evidence: $(VENV)/ready
	PYTHONPATH=benchmarks $(BIN)/python -m literature out/evidence

test: $(VENV)/ready-dev graphics
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder
	$(BIN)/python -m pytest --doctest-modules src/stepblocks

lint: $(VENV)/ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python benchmarks/page_types.py
	$(BIN)/lint-imports

# Run the tests under other processors, threads, Pythons and library versions;
# `make everywhere STAGES=Nehalem` runs some.
everywhere: $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/everywhere.py $(STAGES)

# Feed strange files to every reader, and inject faults at every point of writing.
fuzz: $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/fuzz.py
	$(BIN)/python benchmarks/faults.py

# Two users work for an hour in one folder, while the disk fills, renames wait and the clock jumps.
soak: $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/soak.py

# Put small mistakes into a copy of the core, one at a time, and see whether the tests notice.
# A run can be interrupted: the record in out/ keeps what is done.
mutations: $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/mutations.py

# Measure the figures that the docs quote again, part by part (hours on two cores);
# `make report PARTS="scans drag-paper"` measures some. Records go to docs/records.
report: $(VENV)/ready-all $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/report.py $(PARTS)

licences: $(VENV)/ready-dev
	$(BIN)/python benchmarks/licences.py

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "stepblocks needs Python 3.11 or newer")'
	@echo 'installing into $(VENV): a minute or two'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/ready-all: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[sim,sweep]'
	@touch $@

$(VENV)/ready-dev: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

# The CAD kernel and the renderer load OpenGL from the system, even without a screen.
graphics:
	@[ "$$(uname)" != Linux ] || $(PYTHON) -c 'import ctypes; ctypes.CDLL("libGL.so.1"); ctypes.CDLL("libEGL.so.1")' 2>/dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt-get update -qq \
	       && apt-get install -y -qq libgl1 libegl1 libgl1-mesa-dri libxrender1 >/dev/null; } \
	  || { echo 'OpenGL is missing: install libGL and libEGL, on Debian: apt-get install libgl1 libegl1 libgl1-mesa-dri' >&2; exit 1; }

clean:
	rm -rf $(VENV) $(VENV)-package build dist *.egg-info src/*.egg-info
