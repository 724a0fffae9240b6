# make run   sets up and drives the simulated rover for a minute
# make test  sets up and passes the tests (lint, types, tests)
# make fuzz  looks for inputs that no property test has drawn yet, 20 times as many, and prints those that fail
# make mutations  tries 5000 and more hostile files, replies, frames and payloads of each kind, and prints how many hurt
# make sbom  writes what an installation consists of, with hashes: build/sbom.cdx.json (CycloneDX)
# make audit asks for known weaknesses in what is pinned; says so where no service answers
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes
export OPENBLAS_NUM_THREADS := 1
export RERUN_ANALYTICS := off

.PHONY: run test check lint types fuzz mutations sbom audit bench soak faults browser system ros firsthour reference docs lock clean help

help:
	@sed -n 's/^# //p' Makefile

run: $(VENV)/.installed
	$(BIN)/infant run --config config/mock.toml $(ARGS)

# Two processes; tests/conftest.py says what runs in which. ARGS="-n 0" for one, whose output -s shows.
test: $(VENV)/.installed-dev lint types
	$(BIN)/python -m pytest -n 2 --dist loadscope $(ARGS)

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

fuzz: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile=fuzz --timeout=0 $(ARGS)

mutations: $(VENV)/.installed-dev
	$(BIN)/python -m tests.support.mutations $(ARGS)

sbom: $(VENV)/.installed-dev
	$(BIN)/python -m tests.support.sbom build/sbom.cdx.json

AUDIT := $(BIN)/uv tool run --quiet --from pip-audit==2.10.1 pip-audit --vulnerability-service osv --disable-pip \
	--require-hashes --requirement requirements.lock --progress-spinner off --format json --output build/audit.json
audit: $(VENV)/.installed-dev
	@mkdir -p build && rm -f build/audit.json
	@$(AUDIT) 2>build/audit.log && echo "no known weakness: build/audit.json" \
	  || { [ ! -s build/audit.json ] || { cat build/audit.json; exit 1; }; \
	  echo "NOT AUDITED: no service of known weaknesses answers, see build/audit.log"; }

bench: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m bench $(ARGS)

soak: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m soak $(ARGS)

# Real time: on a machine that is busy with other things the drivers see what those do to them, too.
faults: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n 0 -s -m faults $(ARGS)

browser: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m browser $(ARGS)

system: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m system $(ARGS)

ros: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -m ros2 $(ARGS)

firsthour: $(VENV)/.installed-dev
	$(BIN)/python -m runtime.studies.first_hour $(ARGS)

reference: $(VENV)/.installed-dev
	$(BIN)/python -m docs.generate.pages

docs: $(VENV)/.installed-dev
	$(BIN)/python -m sphinx -W --keep-going -q -d build/doctrees docs build/docs
	$(BIN)/python -m pytest -m docs $(ARGS)
	@echo "the pages: build/docs/index.html"

# Debian's python3 has no venv module of its own; it is a package, installed here where that is allowed.
$(VENV)/bin/python:
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || { rm -rf $(VENV); \
	  echo "python3 has no venv module: installing the package python3-venv"; \
	  if [ "$$(id -u)" = 0 ]; then S=; else S="sudo -n"; fi; \
	  { $$S apt-get update -qq && $$S apt-get install -y -qq python3-venv >/dev/null; } \
	    || { echo "make: cannot install it; run 'sudo apt-get install python3-venv' and then make again" >&2; exit 1; }; \
	  $(PYTHON) -m venv $(VENV); }

$(VENV)/.installed: requirements.lock pyproject.toml | $(VENV)/bin/python
	@echo "setting up $(VENV) (once, some minutes)"
	@$(PIP_INSTALL) -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@echo "compiling the kernels of the filter (once)"
	@$(BIN)/infant warmup
	@touch $@

$(VENV)/.installed-dev: requirements-dev.lock $(VENV)/.installed
	@$(PIP_INSTALL) --no-build-isolation --use-pep517 -r requirements-dev.lock
	@touch $@

# Locks anew, and what the index says of each file in them; by hand, commit the result. Pins stay unless ARGS=--upgrade.
# One lock serves Python 3.11.0 to 3.14, x86-64 and aarch64; tests/test_locks.py holds it to that.
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--custom-compile-command "make lock" --group build pyproject.toml
lock: $(VENV)/.installed-dev
	$(LOCK) $(ARGS) --extra dev -o requirements-dev.lock
	$(LOCK) $(ARGS) --extra review -c requirements-dev.lock -o requirements.lock
	$(BIN)/python -m tests.support.lock_facts

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache
