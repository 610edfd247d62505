# Two commands: `make run` sets everything up and runs the main job, `make test` sets everything up and passes the tests.

VENV ?= .venv
PYTHON ?= python3
BIN := $(VENV)/bin

.PHONY: run example test lint everywhere graphics clean

run: $(VENV)/ready graphics
	@$(BIN)/stepblocks build

# A simulated session with an effect that it does not declare, made from its recipe, and what the loop says of it.
example: $(VENV)/ready
	rm -rf out/example-session
	$(BIN)/stepblocks simulate-session examples/undeclared.toml -o out/example-session
	$(BIN)/stepblocks loop out/example-session -o out/example-loop

test: $(VENV)/ready-dev graphics
	$(BIN)/python -m pytest -n auto --dist loadfile
	$(BIN)/python -m pytest --doctest-modules src/stepblocks

lint: $(VENV)/ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The same answers under other processors, threads, Pythons and library versions; `make everywhere STAGES=Nehalem` for some.
everywhere: $(VENV)/ready-dev graphics
	$(BIN)/python benchmarks/everywhere.py $(STAGES)

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "stepblocks needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/ready-dev: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

# The CAD kernel and the renderer load OpenGL from the system, also without a screen.
graphics:
	@[ "$$(uname)" != Linux ] || $(PYTHON) -c 'import ctypes; ctypes.CDLL("libGL.so.1"); ctypes.CDLL("libEGL.so.1")' 2>/dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt-get update -qq \
	       && apt-get install -y -qq libgl1 libegl1 libgl1-mesa-dri libxrender1 >/dev/null; } \
	  || { echo 'OpenGL is missing: install libGL and libEGL, on Debian: apt-get install libgl1 libegl1 libgl1-mesa-dri' >&2; exit 1; }

clean:
	rm -rf $(VENV) build *.egg-info src/*.egg-info
