# Each target does all the set-up that it needs: Python >= 3.11 and make are enough.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
EXECUTOR ?= processes
READY  := $(VENV)/.ready
TOOLS  := $(VENV)/.tools
# what Python needs to run nearlift, and what tests, linters and the site need besides
RUN_LOCK  := requirements.lock
DEV_LOCK  := requirements-dev.lock
# measured on Linux once Python has compiled what it imports; pip compiles nothing
RUN_SIZE  := 52 packages, 690 MB,
DEV_SIZE  := some 110 packages, 1300 MB,
CORE := declare models effects likelihood reduction fit loop
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

.PHONY: demo measured test nightly lint check mutate bench calibrate docs build clean

demo: $(READY)            ## the main job on the embedded, simulated campaign; ends with the path of the report
	$(BIN)/nearlift demo

measured: $(READY)        ## fetch the public campaigns by digest, run the loop on each, and write docs/measured.md
	$(BIN)/python -m measured

test: $(TOOLS)            ## all tests but the slow calibration; with COVERAGE=1, the share of lines that they run, by package
	$(BIN)/$(if $(COVERAGE),coverage run -m )pytest -n auto --dist worksteal
	$(if $(COVERAGE),$(BIN)/python -m tests.coverage_by_package)

nightly: $(TOOLS)         ## the tests that are too slow for every change
	$(BIN)/pytest -n auto --dist worksteal -m nightly

lint: $(TOOLS)            ## format, lint, types, layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint              ## the inner loop: lint, and the tests of the core
	$(BIN)/pytest -q -n 2 $(CORE:%=tests/%)

mutate: $(TOOLS)          ## sixty seeded mutants of the core, and which of them the tests kill
	nice $(BIN)/python -m tests.mutation --save

bench: $(TOOLS)           ## every benchmark beside its peer
	$(BIN)/python -m benchmarks

calibrate: $(TOOLS)       ## the statistical promises, at record level; hours on a laptop, so EXECUTOR=dask:ADDRESS may spread them
	$(BIN)/pytest -m calibration --executor $(EXECUTOR) --durations=0

docs: $(TOOLS)            ## the reference pages from the declarations, and the site, into site/; a warning is an error
	$(BIN)/python docs/build_reference.py
	$(BIN)/python docs/draw_architecture.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

$(READY): $(RUN_LOCK) pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "nearlift needs Python 3.11 or newer; say make PYTHON=python3.11")'
	@echo "installs $(RUN_SIZE) into $(VENV)"
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) --require-hashes --requirement $(RUN_LOCK)
	find $(VENV)/lib -type d '(' -name tests -o -path '*/pyarrow/include' ')' -prune -exec rm -rf {} +
	$(INSTALL) --no-deps --no-build-isolation --editable .
	$(BIN)/python -m compileall -q pipeline/nearlift
	touch $(READY)

$(TOOLS): $(DEV_LOCK) $(READY)
	@echo "adds $(DEV_SIZE) to $(VENV): what tests need besides"
	$(INSTALL) --require-hashes --requirement $(RUN_LOCK) --requirement $(DEV_LOCK)
	touch $(TOOLS)

build: $(READY)           ## the wheel and the source archive, into dist/
	$(BIN)/python -m hatchling build

clean:                    ## the environment, the caches and the demo; never a campaign's products
	rm -rf $(VENV) dist demo-campaign processed/demo reports/demo .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
