# `make demo` and `make test` need only Python 3.11+, make and git: they make their own .venv.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin

.PHONY: demo test stress fuzz bench loops slam-bench lint docs clean

demo: $(VENV)/.installed
	$(BIN)/m2t-text demo

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n auto

stress: $(VENV)/.installed-test
	$(BIN)/python tests/stress.py

# FUZZ_RUNS=1000 picks the inputs for each reader, FUZZ_MINUTES=30 an end, FUZZ_JOBS=1 how many readers side by
# side; findings are kept in indexes/fuzz.
fuzz: $(VENV)/.installed-fuzz
	$(BIN)/python tests/fuzz/fuzz.py $(TARGETS)

# BENCH_SIZES=1000,13600 picks the sizes of the databases; they are kept in indexes/bench.
bench: $(VENV)/.installed-bench
	$(BIN)/python tests/benchmarks/bench.py

# make loops LOGS="a.log b.log.gz": how far loops correct the trajectories of logs with corrected poses.
loops: $(VENV)/.installed-test
	$(BIN)/m2t-text evaluate-loops $(LOGS)

# SLAM_LOGS is the folder of the logs and relations, NAME.log.gz and NAME.relations.gz.
slam-bench: $(VENV)/.installed
	$(BIN)/python tests/benchmarks/slam_bench.py

lint: $(VENV)/.installed-lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	@touch $@

$(VENV)/.installed-fuzz: $(VENV)/.installed-test
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[fuzz]'
	@touch $@

$(VENV)/.installed-lint: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[lint]'
	@touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	@touch $@

$(VENV)/.installed-bench: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	@touch $@

clean:
	rm -rf $(VENV) demo site build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
