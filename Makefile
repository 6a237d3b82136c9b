# `make run` shows the product, `make check` is for each edit, `make test` is all that CI runs, `make bench` measures.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
QUICK  := "not process and not ros and not slow"

.PHONY: run gallery identify check quick coverage test pytest docs alicatlib colcon tf2_msgs aarch64 lint bench soak newest numerics clean
.DEFAULT_GOAL := run

run: $(VENV)/.installed
	@$(BIN)/soro run config/scenes/track_circle.yaml

# Runs every scene in lockstep, and makes the page and the pictures of docs/gallery.md; some ten minutes.
gallery: $(VENV)/.installed
	$(BIN)/python -m docs.gallery

# Three arms that no file states, from a description to a controlled tip; some half an hour.
identify: $(VENV)/.installed-test
	$(BIN)/python -m benchmarks --only whole_way

# What to run after each edit: the tests that start no process, open no socket, need no node and take no whole run.
check: $(VENV)/.installed-test
	@$(MAKE) --no-print-directory --keep-going -j 2 lint quick

quick: export PYTHONDONTWRITEBYTECODE =
quick: $(VENV)/.installed-test
	$(BIN)/pytest -n 2 --dist worksteal --quiet --durations=0 --durations-min=5 -m $(QUICK)

# Lines of soro_core that `make check` runs, without those of compiled kernels; some ten minutes.
coverage: $(VENV)/.installed-test
	$(BIN)/coverage run -m pytest -n 0 --quiet -m $(QUICK)
	$(BIN)/coverage report --skip-covered

# In parallel, because the tests do not use both cores all the time; a failure of one does not stop the other.
# The longest begins first.
test: $(VENV)/.installed-test
	@$(MAKE) --no-print-directory --keep-going -j 2 pytest lint docs

# The tests start hundreds of processes; without byte code each of them would compile the package anew. With
# three workers on two cores, tests of devices miss their deadlines, and the whole is no faster.
pytest: export PYTHONDONTWRITEBYTECODE =
pytest: $(VENV)/.installed-test
	$(BIN)/pytest -n 2 --dist worksteal

# The site of the pages: open build/docs/index.html, which needs no network. A warning is an error.
docs: $(VENV)/.installed-test
	$(BIN)/sphinx-build --quiet --fresh-env --fail-on-warning --keep-going -c docs -d build/.doctrees . build/docs
	@echo "open build/docs/README.html"

# The client library of another author asks for Python 3.13: `make alicatlib VENV=.venv-3.13 PYTHON=python3.13`.
alicatlib: $(VENV)/.installed-test
	$(BIN)/pytest tests/soro_hardware/test_alicatlib.py

# Builds with the colcon from PyPI as in a conventional ROS 2 installation, and starts what it installs.
COLCON := .venv-colcon
colcon: $(COLCON)/.installed $(VENV)/.installed-test
	COLCON=$(COLCON)/bin/colcon $(BIN)/pytest tests/installation/test_colcon.py

$(COLCON)/.installed:
	$(PYTHON) -m venv $(COLCON)
	$(COLCON)/bin/python -m pip install --quiet --disable-pip-version-check colcon-common-extensions 'setuptools>=68,<80'
	@touch $@

# The messages of /tf, which the ROS wheels lack: with cmake and g++, and their generators beside the environment.
tf2_msgs: $(VENV)/.tf2_msgs

$(VENV)/.tf2_msgs: tests/installation/tf2_msgs.py | $(VENV)/.installed-test
	$(BIN)/python -m tests.installation.tf2_msgs
	@touch $@

# Drivers, board and model as on a Raspberry Pi, in emulation: with qemu-user-static, on Debian or Ubuntu; some half an hour.
aarch64: $(VENV)/.installed-test
	$(BIN)/python -m tests.installation.aarch64

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The peer of the comparison is optional: without it soro is measured alone.
bench: $(VENV)/.installed
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	$(BIN)/python -m benchmarks

# Ten minutes of the loop in one process: fails where memory or file handles grow. SOAK='--minutes 1 --rate-hz 100'
soak: $(VENV)/.installed
	$(BIN)/python -m benchmarks.soak $(SOAK)

# Fresh environments, of each Python that this machine has: the newest packages, and the lowest that are stated.
# NEWEST='--only 3.12' makes one; NEWEST='--beyond numba' takes the newest numba, whatever pyproject.toml allows.
newest: $(VENV)/.installed-test
	$(BIN)/python -m tests.installation.environments $(NEWEST)

# The tests marked `numerics` under three kinds of kernels of OpenBLAS, whose last digits differ.
numerics: $(VENV)/.installed-test
	$(BIN)/pytest tests/installation/test_openblas.py

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml setup.py | $(VENV)/bin/python
	@echo "installing soro and its packages into $(VENV), once: one or two minutes"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[all]'
	@touch $@

$(VENV)/.installed-test: pyproject.toml setup.py | $(VENV)/bin/python
	@echo "installing soro and its packages into $(VENV), once: one or two minutes"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[all,test,docs]'
	@touch $@ $(VENV)/.installed

clean:
	rm -rf .venv* build *.egg-info .pytest_cache .mypy_cache .ruff_cache
