# The tasks of this repository; `make help` lists them.

PYTHON ?= python3
# Test processes: the tests are independent of each other, and often wait for a kernel, a browser or Ray.
JOBS ?= 3
# How often `make soak` kills a search (and a twentieth of that in each parallel engine), and the tests it runs.
KILLS ?= 1000
# How many damaged files `make soak` hands to each reader; `make test` takes 50.
FUZZ ?= 2000
SOAK := tests/search/test_search_killed.py tests/search/test_search_killed_engines.py
SOAK += tests/outside/test_outside_fuzz.py
# More for pytest, for instance: make test PYTEST="-k pool"
PYTEST ?=

BIN := .venv/bin
comma := ,
# What the demo needs, and with it what all other tasks do.
DEMO := .venv/.demo
INSTALLED := .venv/.installed
PEERS := .venv-peers/.installed
# Outputs, counts, and what papermill and widgets leave behind; as in .pre-commit-config.yaml.
STRIP := --keep-id --extra-keys "metadata.papermill metadata.widgets cell.metadata.papermill"
NOTEBOOKS = $(shell git ls-files '*.ipynb')

# Several processes share the cores, and arithmetic in one thread is the same on every machine.
export OMP_NUM_THREADS ?= 1
# Installed without bytecode, which the first import writes: without it every process would compile torch anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo test peers soak lint lab screenshots docs site bench searches evidence clean

help: ## list these tasks
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/make \1	\2/' | expand -t 20

demo: $(if $(wildcard $(INSTALLED)),$(INSTALLED),$(DEMO)) ## both stages on the embedded bank, in about two minutes
	env -u OMP_NUM_THREADS $(BIN)/sfkit demo

test: $(INSTALLED) ## run all tests
	$(BIN)/python -m pytest --slow -n $(JOBS) --dist loadfile --no-loadscope-reorder $(PYTEST)

peers: $(PEERS) ## cross-check merging against mergekit, in its own environment
	.venv-peers/bin/python -m pytest tests/peers $(PYTEST)

soak: $(INSTALLED) ## kill searches at many more random moments, damage many more files; KILLS=1000, FUZZ=2000
	SFKIT_FUZZ=$(FUZZ) SFKIT_KILLS=$(KILLS) SFKIT_ENGINE_KILLS=$$(( ($(KILLS) + 19) / 20 )) SFKIT_KILLS_SEED=$$(date +%s) \
	  $(BIN)/python -m pytest --slow -n $(JOBS) -o faulthandler_timeout=0 $(SOAK) $(PYTEST)

lint: $(INSTALLED) ## check style, types, and that notebooks carry no outputs
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(if $(NOTEBOOKS),$(BIN)/nbstripout --verify $(STRIP) $(NOTEBOOKS))

lab: $(INSTALLED) ## open the notebooks in JupyterLab
	$(BIN)/jupyter lab notebooks

screenshots: $(INSTALLED) ## pictures of the widgets, light and dark, for the README
	$(BIN)/python docs/screenshots.py

docs: $(patsubst notebooks/%.ipynb,build/notebooks/%.html,$(NOTEBOOKS)) site ## run the notebooks on the bank, and build the documentation in build/site

site: $(INSTALLED) ## build the documentation without running the notebooks; warnings are errors
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

build/notebooks/%.html: notebooks/%.ipynb | $(INSTALLED)
	$(BIN)/sfkit report $< $(if $(shell grep -l '"quick = ' $<),-p quick true) -p out build/notebooks/runs/$* -o $@

bench: $(PEERS) ## measure merging, searches and engines beside their peers, into benchmarks/README.md
	env -u OMP_NUM_THREADS .venv-peers/bin/python benchmarks/results.py merging search engines scale

searches: $(PEERS) ## compare searches with their peers, hours; goes on where it was
	.venv-peers/bin/python benchmarks/optimum.py
	.venv-peers/bin/python benchmarks/stage2.py
	.venv-peers/bin/python benchmarks/results.py search optimum stage2 overhead

evidence: $(INSTALLED) ## compare plain and guarded Stage 2, hours; goes on where it was
	$(BIN)/python benchmarks/evidence.py
	$(BIN)/python benchmarks/evidence.py --sharp
	$(BIN)/python benchmarks/results.py evidence evidence-sharp

clean: ## remove caches and build results, but not .venv
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +

# Made again only when what is to be installed has changed.
define install
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "sfkit needs Python 3.11 or newer, $(PYTHON) is older: make PYTHON=python3.11 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install -qq --disable-pip-version-check --no-compile -c constraints.txt -e '.$(1)'
	@touch $(2)
endef

$(DEMO): pyproject.toml constraints.txt
	$(call install,,$@)

$(INSTALLED): pyproject.toml constraints.txt
	$(call install,[jupyter$(comma)dev$(comma)docs$(comma)browser$(comma)ray$(comma)export],$@)

# What .venv holds, and the peers: an environment of their own that borrows the other one's packages.
$(PEERS): $(INSTALLED) constraints-peers.txt
	$(BIN)/python -m venv .venv-peers
	$(BIN)/python -c "import sysconfig; print('import site; site.addsitedir(%r)' % sysconfig.get_path('purelib'))" \
	  > $$(.venv-peers/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/borrowed.pth
	.venv-peers/bin/python -m pip install -qq --disable-pip-version-check --no-deps -r constraints-peers.txt
	@touch $@
