# `make demo` and `make test` need only Python 3.11+, make and git: they make their own .venv.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin

.PHONY: help demo test long-test web-test cluster-test ros-test web-bench cluster-bench live-bench patrol-bench \
  pf-bench stress fuzz bench loops slam-bench calibrate lint docs docs-check notebooks clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(VENV)/.installed  ## see it work: simulate, index, search, draw
	$(BIN)/m2t-text demo

test: $(VENV)/.installed-test  ## the tests, two minutes on two cores
	$(BIN)/python -m pytest -n auto --dist loadfile

long-test: $(VENV)/.installed-test  ## the same on whole real drives, and with more examples
	$(BIN)/python -m pytest -m long -n auto

stress: $(VENV)/.installed-test  ## crashes, full disks, damage, strangers: four minutes
	$(BIN)/python tests/stress.py

# FUZZ_RUNS=1000 picks the inputs for each reader, FUZZ_MINUTES=30 an end, FUZZ_JOBS=1 how many readers side by
# side; findings are kept in indexes/fuzz.
fuzz: $(VENV)/.installed-fuzz  ## damaged inputs for every reader
	$(BIN)/python tests/fuzz/fuzz.py $(TARGETS)

# Chromium and axe-core are installed where they can be; what cannot be tested without them is skipped, and said.
web-test: $(VENV)/.installed-web  ## the page in a real browser, and uploads
	@command -v chromium > /dev/null || (apt-get update && apt-get install -y --no-install-recommends chromium) \
	  > /dev/null 2>&1 || echo "Chromium is not there and cannot be installed here: the page is not tested"
	@test -d node_modules/axe-core || npm install --silent --no-save --no-package-lock axe-core@4 > /dev/null 2>&1 \
	  || echo "axe-core is not there and cannot be installed here: accessibility is not tested"
	$(BIN)/python -m pytest tests/web -m page -rs

# CLUSTER_HOSTS=1 adds several hosts, as network namespaces that root alone can make; LOGS=100 is how many they describe.
cluster-test: $(VENV)/.installed-test  ## a live cluster: exact answers, whatever is killed
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[cluster]' > /dev/null 2>&1 \
	  || echo "Ray cannot be installed here: the cluster is not tested"
	$(BIN)/python -m pytest tests/cluster -m cluster -n 0 -rs || test $$? = 5
	$(if $(CLUSTER_HOSTS),$(BIN)/python tests/cluster/hosts.py)

# WEB_BENCH=pictures,click picks parts; the logs of the Radish repository are needed.
web-bench: $(VENV)/.installed-web  ## what the page must hold: first picture, frames, clicks, drops, many clients
	$(BIN)/python tests/benchmarks/web.py

# BENCH_SIZES=1000,13600 picks the sizes of the databases, which are kept in indexes/bench; BENCH_PARTS=search,find
# picks parts.
bench: $(VENV)/.installed-bench  ## speed and size; writes bench.json
	$(BIN)/python tests/benchmarks/bench.py

# MAPS=13600 picks how many maps.
cluster-bench: $(VENV)/.installed-bench  ## what a search among shards takes, against one index of the same maps
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[cluster]' > /dev/null 2>&1 \
	  || echo "Ray cannot be installed here: it is not measured"
	$(BIN)/python tests/benchmarks/shards.py

# make loops LOGS="a.log b.log.gz": how far loops correct the trajectories of logs with corrected poses.
loops: $(VENV)/.installed-test  ## how far loops correct logs: make loops LOGS="a.log b.log"
	$(BIN)/m2t-text evaluate-loops $(LOGS)

# make calibrate LOGS="a.log b.log.gz": logs with corrected poses, beside simulated buildings. What is looked up, which
# takes minutes a log, is kept in indexes/calibration; the fit takes seconds.
calibrate: $(VENV)/.installed  ## the coefficients of the verdict, fitted, and judged on logs left out
	$(BIN)/python tests/benchmarks/calibrate.py $(LOGS)

# SLAM_LOGS is the folder of the logs and relations, NAME.log.gz and NAME.relations.gz.
slam-bench: $(VENV)/.installed  ## the SLAM benchmark: trajectories before and after loops
	$(BIN)/python tests/benchmarks/slam_bench.py

# In an environment of its own, as the wheels of rclpy restart every Python that finds them. Where there are none,
# for another processor or Python, it says so and succeeds.
ros-test: $(VENV)-ros/.installed  ## the ROS 2 node, with real rclpy, without a network
	@if $(VENV)-ros/bin/python -c 'import rclpy' 2>/dev/null; then \
		tests/ros/isolated.sh $(VENV)-ros/bin/python -m pytest tests/ros -p no:xdist; \
	else echo 'no wheels of rclpy for this machine: the tests of the ROS 2 node are skipped'; fi

$(VENV)-ros/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)-ros
	$(VENV)-ros/bin/python -m pip install --quiet --disable-pip-version-check -e . pytest hypothesis
	$(VENV)-ros/bin/python -m pip install --quiet --disable-pip-version-check -e '.[ros-test]' \
		|| echo 'the wheels of rclpy cannot be installed here'
	@touch $@

# LIVE_PARTS=followed,carried,latency,idle,memory picks parts, LOGS="a.log b.log" logs with corrected poses,
# LIVE_SEED=1 other places to which the robot is carried.
live-bench: $(VENV)/.installed  ## live answers: how right, how soon, how much memory
	$(BIN)/python tests/benchmarks/live_bench.py $(LOGS)

# PATROL_LAPS=20 laps, PATROL_KEEP=1,2,4 maps of a place.
patrol-bench: $(VENV)/.installed  ## an index that grows for days: what is kept, and what is found in it
	$(BIN)/python tests/benchmarks/patrol.py

# PF_STARTS=100 starts in each log; Debian's package mrpt-apps is installed where it can be.
pf-bench: $(VENV)/.installed  ## beside a particle filter: MRPT's pf-localization
	@command -v pf-localization > /dev/null || (apt-get update && apt-get install -y --no-install-recommends mrpt-apps) \
	  > /dev/null 2>&1 || echo "mrpt-apps is not there and cannot be installed here"
	$(BIN)/python tests/benchmarks/particle_filter.py $(LOGS)

lint: $(VENV)/.installed-lint  ## ruff, mypy and the layers of the package
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.installed-docs  ## the site, in site/
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# UPDATE=1 writes what is stale anew, CHEAP=1 leaves out what takes long, PAGES="README.md docs/loops.md" picks some.
docs-check: $(VENV)/.installed-test  ## whether README and docs show what the commands print, and the notebooks run
	$(BIN)/python tests/docs_check.py $(if $(UPDATE),--update) $(if $(CHEAP),--cheap) $(PAGES)
	$(if $(PAGES),,$(BIN)/python -m pytest tests/test_notebooks.py -m notebook -n 2)

# The logs that they fetch are downloaded once.
notebooks: $(VENV)/.installed-docs $(VENV)/.installed-test  ## run the notebooks, and keep what they show
	$(BIN)/python -m nbconvert --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False \
	  --ExecutePreprocessor.timeout=900 notebooks/*.ipynb

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[web]'
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	@touch $@

$(VENV)/.installed-web: $(VENV)/.installed-test
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[web-test]'
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

clean:  ## remove what was made here
	rm -rf $(VENV) demo site build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
