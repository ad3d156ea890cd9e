# One environment in .venv, built once from the lock file; every target below uses it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: lab test test-all test-quick checks widgets coverage tables bench notebooks site lock release clean

lab: $(READY)
	$(BIN)/crfbench lab notebooks

# One thread each: the matrices are small, and threads that wait for a busy core cost more than they bring.
test test-all test-quick coverage tables bench site: export OPENBLAS_NUM_THREADS = 1
test test-all test-quick coverage: export OMP_NUM_THREADS = 1
# Where this is set, every process that starts would compile tests and package anew.
unexport PYTHONDONTWRITEBYTECODE
# Notebooks and tests together, which keeps every core busy to the end; files in the order of their names.
TESTS := --nbval -n auto --no-loadscope-reorder
test: checks
	$(BIN)/python -m pytest $(TESTS) -m "not slow"

# With the slow tests: many repeats, every page of the site, the benchmarks.
test-all: checks
	$(BIN)/python -m pytest $(TESTS)

# All but the checks of the code and the tests that are slow or need a browser; ONLY="tests/test_cli.py" and such.
test-quick: $(READY)
	$(BIN)/python -m pytest $(TESTS) -m "not slow" --ignore tests/test_browser $(ONLY)

checks: $(READY) widgets
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The widgets' JavaScript, linted, type-checked and tested. It needs no build, and Python needs none of this.
NODE := $(shell node -e 'const [a, b] = process.versions.node.split("."); if (a > 20 || (a == 20 && b > 18)) console.log(a)' 2>/dev/null)
widgets:
ifeq ($(NODE),)
	@echo "Node.js 20.19 or later is not installed: the JavaScript of the widgets is not checked"
else
	test package-lock.json -ot node_modules/.package-lock.json || npm ci --silent --no-audit --no-fund
	npm test --silent
endif

# Statements and branches of the library that the tests reach, those of its subprocesses too.
coverage: $(READY)
	$(BIN)/python -m pytest -n auto --no-loadscope-reorder --cov --cov-report=term

tables: $(READY)
	$(BIN)/crfbench tables --out results
	$(BIN)/crfbench table fitting
	$(BIN)/crfbench table calibration --patches 3
	$(BIN)/crfbench table calibration --patches 24

bench: $(READY)
	$(BIN)/python -m benchmarks --plots results

# Runs every notebook from a fresh kernel and stores the outputs, without widget state or timings.
notebooks: $(READY)
	$(BIN)/python scripts/execute_notebooks.py

# The stored notebooks, the report and the reference as pages; look at them with: python3 -m http.server -d site
site: $(READY)
	rm -rf site
	$(BIN)/python scripts/build_site.py

# Freezes what .venv holds, but for build labels such as +cpu and what only PyTorch's GPU builds need.
lock: $(READY)
	$(BIN)/pip freeze --exclude-editable | sed 's/+[a-z0-9]*$$//' | grep -vE '^(nvidia-|cuda-|triton)' > requirements.lock

# What is published, in dist: both archives, checked, and the bill of materials (SBOM) of what the lock installs.
release: $(READY)
	rm -rf dist
	$(PYTHON) -m venv $(VENV)/release
	$(VENV)/release/bin/pip install --quiet build twine cyclonedx-bom
	$(VENV)/release/bin/python -m build --outdir dist .
	$(VENV)/release/bin/twine check --strict dist/*
	$(VENV)/release/bin/cyclonedx-py environment --output-reproducible --output-file dist/sbom.json $(BIN)/python

clean:
	rm -rf $(VENV) node_modules results site dist

$(READY): pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; v = sys.version_info[:2]; v >= (3, 11) and v < (3, 14) or sys.exit(f"crfbench needs Python 3.11 to 3.13, this is {v[0]}.{v[1]}; choose one with: make PYTHON=python3.12 $(MAKECMDGOALS)")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint requirements.lock --editable '.[dev]'
	$(BIN)/python -m pip install --quiet --constraint requirements.lock --no-deps spectral-film-lut
	touch $@
