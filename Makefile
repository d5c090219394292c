# One command for each thing that a developer does. Every target sets up .venv first, and that costs
# nothing once it is done: the stamp is older than pyproject.toml only when something has to be installed.
#
#   make                 the same as make setup
#   make demo            a whole flight on this machine
#   make check           everything that has to hold before a change lands
#   make PYTHON=python3.13 setup    another interpreter (3.11 or later)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.set-up
PROTOS := $(wildcard events/schema/*.proto autopilot/wire/*.proto)
# Tests marked `whole` start processes of their own and mostly wait: after all others, two files at a time.
PYTEST := $(BIN)/pytest -n 2 -m "not whole" && $(BIN)/pytest -n 2 --dist loadfile -m whole

.DEFAULT_GOAL := setup
.PHONY: setup demo test check format bench torture proto diagrams

setup: $(STAMP)

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "autopilot needs Python 3.11 or later; '$(PYTHON)' is not that. Name another: make PYTHON=python3.12" >&2; \
	  exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "setting up $(VENV) (once)" >&2
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $(STAMP)

demo: setup
	$(BIN)/autopilot demo

test: setup
	$(PYTEST)

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(PYTEST)

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: setup
	$(BIN)/python -m tests.bench

torture: setup
	$(BIN)/python -m tests.torture

proto: setup
	$(BIN)/python -m grpc_tools.protoc -I. --python_out=. --mypy_out=quiet:. \
	  --plugin=protoc-gen-mypy=$(BIN)/protoc-gen-mypy $(PROTOS)

diagrams: setup
	$(BIN)/python -m docs.generate
