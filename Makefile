# Two commands are all a newcomer needs: `make run` and `make test`.
# The virtual environment is made from the lock files, and made anew when they change.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: run setup setup-dev test lint bench lock clean help

run: setup ## start the service and the simulated robot on http://localhost:8007
	$(BIN)/cobot run

setup: $(VENV)/.run-stamp ## make the virtual environment that `make run` uses

setup-dev: $(VENV)/.dev-stamp ## add what the tests and benchmarks need

test: setup-dev lint ## lint, types, import contract, unit, property and end-to-end tests
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --ignore tests/e2e/realtime
	$(BIN)/python -m pytest tests/e2e/realtime

lint: setup-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup-dev ## print the benchmark table
	$(BIN)/python -m benchmarks

lock: setup-dev ## resolve the pinned versions and hashes anew
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	    pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	    --extra dev -c requirements.lock pyproject.toml -o requirements-dev.lock

clean:
	rm -rf $(VENV) build *.egg-info

help:
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(VENV)/.run-stamp: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("cobot needs Python 3.11 or newer, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv --clear $(VENV)
	$(PIP) install --require-hashes --requirement requirements.lock
	$(PIP) install --no-deps --editable .
	touch $@

$(VENV)/.dev-stamp: $(VENV)/.run-stamp requirements-dev.lock
	$(PIP) install --require-hashes --requirement requirements-dev.lock
	touch $@
