# Owns: the few commands a person types, from a bare checkout with Rust 1.95+ and Python 3.10+. `make` alone lists them.
#
# The Python package, its tools and the compiled core live in .venv. Stamps in it make a second call quick: tools
# follows pyproject.toml, package follows the Rust sources as well. Python files are used in place.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.NOTPARALLEL:
.DEFAULT_GOAL := help

# in CI the lock file is law; at home cargo may follow an edited Cargo.toml
LOCKED := $(if $(CI),--locked)
EXTRAS := dev,mat
RUST_SOURCES := Cargo.toml Cargo.lock $(shell find crates -type f \( -name '*.rs' -o -name '*.toml' \))
PYTHON_SOURCES := python tests tools benches

# pyo3 must neither look for libpython nor be compiled anew when another python3 comes first on the PATH
export PYO3_BUILD_EXTENSION_MODULE := 1
export PYO3_PYTHON := $(abspath $(BIN)/python)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help
help: ## list these commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: setup
setup: $(VENV)/package.stamp ## create .venv with the compiled package and its tools

.PHONY: demo
demo: setup ## find the physics that a recording has and its model lacks
	@$(BIN)/ltp demo

.PHONY: test
test: test-rust test-python ## run all tests

.PHONY: test-rust
test-rust: setup ## run the Rust tests
	cargo test --release --workspace $(LOCKED)

.PHONY: test-python
test-python: setup ## run the Python tests
	$(BIN)/pytest

.PHONY: proofs
proofs: setup ## run the tests on real recordings that take minutes (LTP_DATA names their folder)
	LTP_LONG=1 $(BIN)/pytest tests/test_real_recordings.py

.PHONY: check
check: test check-rust check-python check-house ## the gate: tests, formats, lints, types, licences, architecture
	@echo "ltp: the gate is passed"

.PHONY: check-rust
check-rust: setup ## formats, lints, documentation and licences of the Rust part
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets $(LOCKED) -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --document-private-items $(LOCKED)
	@if command -v cargo-deny >/dev/null; then \
	    echo "cargo deny check licenses bans sources"; \
	    cargo deny --offline --workspace check licenses bans sources; \
	else \
	    echo "ltp: skipped the licence check, cargo-deny is not installed ('cargo install cargo-deny' adds it)"; \
	fi

.PHONY: check-python
check-python: setup ## formats, lints and types of the Python part, and the stub of the compiled one
	$(BIN)/ruff check $(PYTHON_SOURCES)
	$(BIN)/ruff format --check $(PYTHON_SOURCES)
	$(BIN)/mypy --strict python/ltp
	MYPYPATH=python $(BIN)/stubtest --mypy-config-file pyproject.toml ltp._ltp

.PHONY: check-house
check-house: setup ## imports and file sizes against docs/house.md
	$(BIN)/python tools/check_house.py

.PHONY: bench
bench: $(VENV)/bench.stamp ## time the core, then race the peers side by side
	cargo bench --workspace $(LOCKED)
	@for run in $(sort $(wildcard benches/*.py)); do echo "== $$run"; $(BIN)/python $$run; done

.PHONY: clean
clean: ## remove .venv and everything built
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis out
	rm -f python/ltp/_ltp*.so python/ltp/_ltp*.pyd
	cargo clean

.PHONY: toolchain
toolchain:
	@bash tools/check_toolchain.sh $(PYTHON)

$(VENV)/tools.stamp: pyproject.toml | toolchain
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet "maturin>=1.16,<2"
	@touch $@

$(VENV)/package.stamp: $(VENV)/tools.stamp $(RUST_SOURCES) | toolchain
	@echo "ltp: compiling the core; the first time takes a few minutes"
	$(BIN)/maturin develop --release --extras $(EXTRAS) $(LOCKED)
	@touch $@

$(VENV)/bench.stamp: $(VENV)/package.stamp
	$(BIN)/maturin develop --release --extras $(EXTRAS),bench $(LOCKED)
	@touch $@
