# These commands do all the set-up on a fresh machine that has Python 3.11 or later (with venv) and make:
#   make demo   runs one inspection and says where its page is
#   make test   passes the tests, but for those that take seconds each: make test-slow passes those
#   make docs   builds the documentation site and says where it is
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/demo
SITE ?= out/site
# Tests start many programs, and pytest itself takes ten seconds to compile the tests: bytecode is kept where Python
# keeps it. (In a folder of its own, that of all libraries would be made once more.) Three tests at once keep two cores
# busy, as some of them wait for a browser.
TESTED := PYTHONDONTWRITEBYTECODE= PYTHONPYCACHEPREFIX= $(BIN)/python -m pytest -n 3 --dist worksteal

.PHONY: demo test test-slow ledger docs lint bench clean

demo: $(VENV)/run.done
	$(BIN)/vibroswarm run --preset paper --strategy soft --seed 2 --out "$(OUT)" --force

test: $(VENV)/dev.done
	$(TESTED) -m "not slow" $(ARGS)

# Cold starts, statistics, clusters, whole reports: half of the time of all tests. CI runs both.
test-slow: $(VENV)/dev.done
	$(TESTED) -m slow $(ARGS)

# Values that no change may move, and statistics that move on purpose only.
ledger: $(VENV)/dev.done
	$(BIN)/python tests/helpers/ledger.py

docs: $(VENV)/docs.done
	$(BIN)/python -m sphinx -q -E -W --keep-going -b html docs "$(SITE)"
	@echo "Open $(abspath $(SITE))/index.html in a browser."

lint: $(VENV)/dev.done
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/helpers/ratchet.py >/dev/null

bench: $(VENV)/dev.done
	$(BIN)/python benchmarks/speed.py

clean:
	rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "vibroswarm needs Python 3.11 or later; say make PYTHON=python3.12, for example")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.done: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

$(VENV)/docs.done: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[docs]"
	touch $@ $(VENV)/run.done

$(VENV)/dev.done: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@ $(VENV)/run.done $(VENV)/docs.done
