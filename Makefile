# `make demo` and `make test` do all set-up: a virtual environment in .venv with the pinned packages.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test lint types check bench wheel pictures lock clean

demo: $(READY)  ## run the main job and print where its recording is
	$(BIN)/simrob run irb120_dynamic --out runs/demo --force

test: $(READY)  ## run all tests
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

check: lint types test

bench: $(READY)  ## measure speed and memory
	$(BIN)/python -m tests.benchmarks

wheel: $(READY)
	$(BIN)/python -m build --wheel --outdir dist .

pictures: $(READY)  ## renew the block pictures beside the stations, the schemas, and the pictures of README and docs
	$(BIN)/python -m simrob_drake.results.block_diagram.picture
	$(BIN)/python -m simrob_drake.stations.schema
	$(BIN)/python -m simrob_drake.programs.schemas
	$(BIN)/simrob run irb120_dynamic --duration 1.2 --out runs/readme --force
	cp runs/readme/film_strip.png docs/irb120_dynamic.png
	$(BIN)/simrob walk roid1_dynamic --steps 20 --out runs/docs --force
	cp runs/docs/film_strip.png docs/roid1_walk.png

lock: $(READY)  ## pin the newest packages that pyproject.toml allows
	$(BIN)/python -m pip install --quiet pip-tools
	$(BIN)/pip-compile --quiet --upgrade --extra dev --extra video --strip-extras --no-header --no-annotate \
	  --no-emit-index-url --no-emit-trusted-host --no-emit-find-links --output-file requirements.lock pyproject.toml

$(READY): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "simrob_drake needs Python 3.11 or newer; name one: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	@touch $(READY)

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache
