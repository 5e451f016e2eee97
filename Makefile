# `make demo` and `make test` do all of the set-up themselves: a virtual environment and a pinned installation.
PYTHON ?= python3
VENV ?= .venv
PEERS := .venv-peers
ROBOTS := .robots
SIMULATORS := .simulators
EXTRAS := .extras
NEWEST := .venv-newest
FEW_TESTS := tests/core tests/xla/test_unknown_operations.py tests/xla/test_one_loop.py tests/xla/test_compiled_in_c.py \
	tests/xla/test_same_as_written.py::test_what_should_be_taken_apart_is tests/cli/test_without_extras.py \
	tests/xla/test_precision.py::test_physics_in_mjx tests/evaluation/test_physics.py
BIN := $(VENV)/bin
DATA := $(abspath ../shared/data)
DEMO := out/drawer_closing/drawer_closing.skill.npz --scene drawer --json out/drawer_closing/run.json

# The real recordings, where they are at hand; without them demos are synthetic and some tests are skipped.
ifndef JAXRMP_DATA
ifneq ($(wildcard $(DATA)/franka),)
export JAXRMP_DATA := $(DATA)
endif
endif
# Compiled programs are kept between runs, beside the virtual environment.
export JAX_COMPILATION_CACHE_DIR ?= $(abspath .jax_cache)
export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS ?= 0

.PHONY: demo test test-newest osmesa chromium check format docs bench peers robots simulators extras clean

demo: $(VENV)/.installed-demo osmesa
	$(BIN)/jaxrmp learn configs/drawer_closing.toml --out out/drawer_closing
	$(BIN)/jaxrmp reproduce out/drawer_closing/drawer_closing.skill.npz --json out/drawer_closing/reproduction.json
	@if [ "$$(uname)" = Linux ] && [ -z "$$DISPLAY$$MUJOCO_GL" ] && ! ldconfig -p | grep -q libOSMesa; then \
		echo "No video and pictures: they need OSMesa (as root: apt-get install libosmesa6)."; \
		$(BIN)/jaxrmp run $(DEMO); \
	else $(BIN)/jaxrmp run $(DEMO) --video out/drawer_closing/drawer.mp4 --figures out/drawer_closing/figures; fi
	@echo "The drawer is closed. To read: out/drawer_closing/report.html and run.html; skill, video, pictures beside them."

test: $(VENV)/.installed-dev osmesa chromium
	$(BIN)/python -m pytest -n auto --dist loadfile --durations=10

# What another Python and its JAX may break, by the newest Python that is at hand: the core, what is taken apart, a skill
# that is learned and run in physics, MJX. Everything with it: make test PYTHON=python3.13 VENV=.venv-newest
test-newest:
	@python=$$(.ci/newest_python) || { echo "Skipped: tests with a newer Python, of which none is at hand."; exit 0; }; \
		$(MAKE) --no-print-directory VENV=$(NEWEST) PYTHON="$$python" $(NEWEST)/.installed-few && \
		$(NEWEST)/bin/python -m pytest -n auto --dist loadfile --durations=5 $(FEW_TESTS)

# What MuJoCo needs to draw without a display, where we may install it.
osmesa:
	@if [ "$$(uname)" = Linux ] && [ -z "$$DISPLAY$$MUJOCO_GL" ] && ! ldconfig -p | grep -q libOSMesa && \
			[ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null; then \
		{ apt-get update -qq && apt-get install -y -qq --no-install-recommends libosmesa6; } > /dev/null || true; fi

# The browser that the tests of the viewer drive, where we may install it.
chromium:
	@if [ "$$(uname)" = Linux ] && ! command -v chromium > /dev/null && \
			[ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null; then \
		{ apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } > /dev/null || true; fi

check: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright --pythonpath $(BIN)/python

format: $(VENV)/.installed-dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# The documentation as a site in out/site; `make docs` and open out/site/index.html.
docs: $(VENV)/.installed-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "jaxrmp needs Python 3.11 or newer, and '$(PYTHON)' is older: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed-demo: $(BIN)/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all]'
	@touch $@

$(VENV)/.installed-few: $(BIN)/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[learning,simulation]' \
		pytest pytest-timeout pytest-xdist filelock
	@touch $@

$(VENV)/.installed-dev: $(BIN)/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all,franka,torch,peers,dev]'
	@touch $@

# How fast it is: tables, JSON and plots in out/benchmarks, then the bars. Run `make peers` before, to compare with fabrics.
bench: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks all

# Peers whose requirements are at odds with ours, in an environment of their own.
peers: $(PEERS)/.installed

$(PEERS)/.installed: benchmarks/peers.txt
	$(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check -r benchmarks/peers.txt
	@touch $@

# Robots of others, for `python -m benchmarks robots` and `view`: their files alone.
robots: $(ROBOTS)/.installed

$(ROBOTS)/.installed: $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --target $(ROBOTS) example-robot-data==6.0.0
	@touch $@

# Simulators of a Franka, for `python -m benchmarks franka` and for tests, which are skipped without: 900 MB, and two
# environments of their own.
simulators: $(SIMULATORS)/.installed

$(SIMULATORS)/.installed: benchmarks/simulators.txt benchmarks/simulators_strict.txt
	$(PYTHON) -m venv $(SIMULATORS)/franky
	$(SIMULATORS)/franky/bin/python -m pip install --quiet --disable-pip-version-check -r benchmarks/simulators.txt
	$(PYTHON) -m venv $(SIMULATORS)/strict
	$(SIMULATORS)/strict/bin/python -m pip install --quiet --disable-pip-version-check -r benchmarks/simulators_strict.txt
	@assets=$$($(SIMULATORS)/franky/bin/python -c 'import franky_sim, pathlib; print(pathlib.Path(franky_sim.__file__).parent / "assets")') && \
		sed "s#meshdir=\"assets\"#meshdir=\"$$assets/meshes\"#" $$assets/fr3.xml > $(SIMULATORS)/fr3.part && \
		test -s $(SIMULATORS)/fr3.part && mv $(SIMULATORS)/fr3.part $(SIMULATORS)/fr3.xml
	@touch $@

# Each extra in an environment of its own, put to its smallest use: half an hour and gigabytes.
extras: $(BIN)/python
	$(BIN)/python tests/extras/each_alone.py $(EXTRAS)

clean:
	rm -rf $(VENV) $(NEWEST) $(PEERS) $(ROBOTS) $(SIMULATORS) $(EXTRAS) .jax_cache out dist .pytest_cache .ruff_cache
