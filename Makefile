# Each target does all the set-up that it needs: Python >= 3.11 and make are enough.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
EXECUTOR ?= processes
READY  := $(VENV)/.ready

.PHONY: demo test lint check mutate bench calibrate docs clean

demo: $(READY)            ## the main job on the embedded, simulated campaign; ends with the path of the report
	$(BIN)/nearlift demo

test: $(READY)            ## all tests but the slow calibration
	$(BIN)/pytest -n auto

lint: $(READY)            ## format, lint, types, layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint              ## the inner loop, a minute on two cores: lint, and the quick tests of the core
	$(BIN)/pytest -q -n 2 --core

mutate: $(READY)          ## sixty seeded mutants of the core, and which of them the tests kill
	nice $(BIN)/python -m tests.mutation --save

bench: $(READY)           ## every benchmark beside its peer
	$(BIN)/python -m benchmarks

calibrate: $(READY)       ## the statistical promises, at record level; hours on a laptop, so EXECUTOR=dask:ADDRESS may spread them
	$(BIN)/pytest -m calibration --executor $(EXECUTOR) --durations=0

docs: $(READY)            ## the reference pages from the declarations, and the site, into site/; a warning is an error
	$(BIN)/python docs/build_reference.py
	$(BIN)/python docs/draw_architecture.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# pip compiles what it installs, but not what it leaves in its place
$(READY): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "nearlift needs Python 3.11 or newer; say make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	$(BIN)/python -m compileall -q pipeline/nearlift
	touch $(READY)

clean:                    ## the environment, the caches and the demo; never a campaign's products
	rm -rf $(VENV) demo-campaign processed/demo reports/demo .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
