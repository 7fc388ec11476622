# `make demo` and `make test` do all set-up: a virtual environment in .venv with the pinned packages.
PYTHON ?= $(shell .ci/python)
VENV ?= .venv
BIN := $(VENV)/bin
# what runs a station, and what tests, checks and documents it besides
READY := $(VENV)/.ready
TOOLS := $(VENV)/.tools

# The matrices of a robot are small: more threads only wait for each other.
export OPENBLAS_NUM_THREADS ?= 1
# The tests start some hundred processes: none of them is to compile the package anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: release schemas demo test test-long lint types check bench fuzz wheel docs docs-serve pictures hooks lock clean

demo: $(READY)  ## run the main job and print where its recording is
	$(BIN)/simrob demo

# A worker that dies is not replaced: pytest-xdist 3.8 may wait for the work of the new one for ever (its issue 1378).
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --max-worker-restart 0

test: $(TOOLS)  ## run all tests, or those of TESTS=...
	$(PYTEST) $(TESTS)

test-long: $(TOOLS)  ## run those tests that take long or repeat themselves
	$(PYTEST) --timeout 1200 -m long $(TESTS)

lint: $(TOOLS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m tests.readability --quiet
	@.ci/long_modules

types: $(TOOLS)
	$(BIN)/mypy

check: lint types test

bench: $(TOOLS)  ## measure speed and memory
	$(BIN)/python -m tests.benchmarks

fuzz: $(TOOLS)  ## give a thousand hostile files and options to the command line
	$(BIN)/python -m tests.fuzz

wheel: $(TOOLS)
	$(BIN)/python -m build --wheel --outdir dist .

release: $(TOOLS)  ## make VERSION=0.2.0: checks, version, changelog, wheel, commit and tag; nothing is uploaded
	@.ci/release "$(VERSION)"

docs: $(TOOLS)  ## build the site of docs/ in both languages into build/site; warnings are errors
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict --config-file mkdocs.es.yml
	$(BIN)/python -m docs.site.links build/site

docs-serve: docs  ## show the site on this machine
	$(BIN)/python -m http.server --bind 127.0.0.1 --directory build/site 8000

pictures: $(TOOLS)  ## renew the block pictures beside the stations, the schemas, and the pictures of README and docs
	$(BIN)/python -m simrob_drake.results.block_diagram.picture
	$(BIN)/python -m simrob_drake.stations.schema
	$(BIN)/python -m simrob_drake.programs.schemas
	$(BIN)/python docs/gallery.py
	$(BIN)/simrob run irb120_dynamic --duration 1.2 --frames 4 --out runs/readme --force
	cp runs/readme/film_strip.png docs/irb120_dynamic.png
	$(BIN)/simrob compare irb120_force_stop --out runs/engines --force
	cp runs/engines/engines.png docs/engines.png
	$(BIN)/simrob run zjudancer_walking --set examples/loops/get_up.yaml --set duration=25 \
	  --set 'forces.push={kind: push, start: 3, force: [0, 120, 0]}' --frames 12 --out runs/get_up --force
	cp runs/get_up/film_strip.png docs/zjudancer_get_up.png
	$(BIN)/simrob run examples/stations/zjudancer_stairs.yaml --frames 6 --out runs/stairs --force
	cp runs/stairs/film_strip.png docs/zjudancer_stairs.png
	$(BIN)/simrob run examples/stations/yobotics_rubble.yaml --frames 3 --out runs/rubble --force
	cp runs/rubble/film_strip.png docs/yobotics_rubble.png
	rm -rf runs/pushes && $(BIN)/simrob pushes zjudancer_dynamic --set gait.name=walk --out runs/pushes
	cp runs/pushes/pushes.png docs/zjudancer_pushes.png
	rm -rf runs/gains && $(BIN)/simrob sweep irb120_dynamic --vary servo.kp=log:100:10000:9 --vary pieces.load.mass=0.5,1,2 --out runs/gains
	cp runs/gains/plots/map.png docs/gains_map.png
	for exercise in examples/course/*.py; do $(BIN)/python $$exercise; done
	cp runs/course/*.png docs/course/figures/
	-$(BIN)/python -m docs.teach_pictures  # which needs a browser

schemas: $(TOOLS)  ## renew the schemas of YAML files, which editors read
	$(BIN)/python -m simrob_drake.stations.schema
	$(BIN)/python -m simrob_drake.programs.schemas

hooks: $(TOOLS)  ## let git run ruff and mypy before each commit
	$(BIN)/pre-commit install

lock:  ## pin the newest packages that pyproject.toml allows
	.ci/lock

$(READY): pyproject.toml requirements.lock requirements-3.11.lock requirements-core.lock requirements-core-3.11.lock
	@python="$(PYTHON)"; [ -n "$$python" ] || exit 1; \
	"$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "simrob_drake needs Python 3.11 or newer; name one: make PYTHON=python3.13 ..."; exit 1; }; \
	"$$python" -m venv --clear $(VENV)
	$(BIN)/python -c 'import sys; print("-3.11" * (sys.version_info < (3, 12)) + ".lock")' > $(VENV)/ending
	echo "requirements$$(cat $(VENV)/ending)" > $(VENV)/lock
	$(BIN)/python -m pip install --quiet --require-hashes --requirement "requirements-core$$(cat $(VENV)/ending)"
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $(READY)

$(TOOLS): $(READY)
	$(BIN)/python -m pip install --quiet --require-hashes --requirement "$$(cat $(VENV)/lock)"
	@touch $(TOOLS)

clean:
	rm -rf $(VENV) .venv-other build dist .mypy_cache .ruff_cache .pytest_cache
