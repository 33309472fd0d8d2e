# Everything runs in .venv, which any target makes for itself.  Needs Python 3.11+ and make.
PYTHON ?= python3
BIN := .venv/bin
RUNNING := .venv/.running
READY := .venv/.ready
# Without kept bytecode every program that a test starts compiles fracid again.
unexport PYTHONDONTWRITEBYTECODE
SITE := .venv/.site
PEERS := .venv-bench/.ready
RIVALS := .venv-rivals/.ready
PACKING := .venv-package/.ready

.PHONY: setup demo test test-all test-slow lint count docs bench orders coverage designs claims benchmarks-public bench-peers rivals scaling fuzz fuzz-ci notebook package clean-cache

setup: $(READY)

# What fracid needs, which is enough for the demo: without what tests, checks and pages need.
$(RUNNING): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("fracid needs Python 3.11 or newer; type: make PYTHON=python3.12") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	$(BIN)/python -m compileall -q src
	touch $@

$(READY): $(RUNNING)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

# The paper's experiment on simulated recordings: fits them, writes runs/demo.
demo: $(RUNNING)
	$(BIN)/fracid demo --out runs/demo

# Two minutes on two cores, once the loops are compiled: of every package, and of every table of variants.
test: $(READY)
	$(BIN)/pytest -n 2 --dist worksteal

# Those and whole programs, browsers, examples, the rest of the tables.  Without what make test has run already:
# make test-all MARKED='broad and not slow'
MARKED ?= not slow
test-all: $(READY)
	$(BIN)/pytest -n 2 --dist worksteal -m '$(MARKED)'

# What takes minutes, real recordings included where they are.
test-slow: $(READY)
	$(BIN)/pytest -n 2 --dist worksteal -m slow

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Lines of code without blank lines, comments, docstrings and imports.
count:
	$(PYTHON) benchmarks/count.py

bench: $(READY)
	$(BIN)/python benchmarks/solver.py
	$(BIN)/python benchmarks/stages.py
	$(BIN)/python benchmarks/jacobians.py
	$(BIN)/python benchmarks/evidence.py

# Measured orders and limits of the solver.  Writes the tables and pictures of docs/solver.md.
orders: $(READY)
	$(BIN)/python benchmarks/orders.py --write

# Coverage of the 95 % intervals, on twins of all rigs: half an hour on two cores; resumes where it was
# interrupted.  Writes its part of docs/uncertainty.md.
coverage: $(READY)
	$(BIN)/python benchmarks/intervals.py --write

# Is what fracid design predicts what comes out?  200 twins of each of five plans: an hour on two cores.
designs: $(READY)
	$(BIN)/python benchmarks/designs.py

# What fracid claims of rigs of known truth, made without its solver: hours; resumes where it was interrupted.
claims: $(READY)
	$(BIN)/python benchmarks/claims.py --draws 3

# Silverbox, cascaded tanks, EMPS: a minute each.  Their records are looked for in FRACID_BENCHMARKS, else ../shared/benchmarks.
benchmarks-public: $(READY)
	$(BIN)/python benchmarks/public.py

# Error against time, fracid and its peers; they live in a venv of their own.  Writes docs/work-precision.md.
bench-peers: $(PEERS)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 .venv-bench/bin/python -O benchmarks/work_precision.py

$(PEERS): pyproject.toml constraints.txt benchmarks/peers.txt
	$(PYTHON) -m venv .venv-bench
	.venv-bench/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e . -r benchmarks/peers.txt
	touch $@

# Whose intervals hold, and who claims what is not so?  fracid, SciPy and MuJoCo on the same files; MuJoCo lives in a
# venv of its own.  Resumes where it was interrupted.  Writes its part of docs/honesty.md.
rivals: $(RIVALS)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 .venv-rivals/bin/python benchmarks/rivals.py --write

$(RIVALS): pyproject.toml constraints.txt benchmarks/rivals.txt
	$(PYTHON) -m venv .venv-rivals
	.venv-rivals/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e . -r benchmarks/rivals.txt
	touch $@

# Up to 10^7 steps: time, memory, error.  Writes its part of docs/work-precision.md.
scaling: $(READY)
	$(BIN)/python benchmarks/scaling.py

# The documentation as a site: site/index.html opens from files.  Any warning, a dead link for one, ends the build.
docs: $(SITE)
	$(BIN)/sphinx-build --quiet --fresh-env --fail-on-warning --keep-going --nitpicky -b html docs site

$(SITE): $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	touch $@

# Hostile files into every reader, goes on where it stopped until each has had a million: hours.  Then spoilt run folders
# into every command, an hour; a million equations, ten minutes; ten thousand folders of folders, an hour; and the
# property tests with fresh random examples, ten times over.
fuzz: $(READY)
	$(BIN)/python tests/safety/fuzz.py --inputs 1000000 --seconds 7200
	$(BIN)/python tests/safety/fuzz_runs.py --seconds 3600
	$(BIN)/python tests/safety/fuzz_equations.py
	$(BIN)/python tests/safety/fuzz_folders.py --good .venv/.fuzz/good --inputs 10000
	for i in 1 2 3 4 5 6 7 8 9 10; do HYPOTHESIS_PROFILE=explore $(BIN)/pytest -q -x -m hypothesis tests || exit 1; done

# The same hostile files each time, two minutes, and the same spoilt run folders, three.
fuzz-ci: $(READY)
	$(BIN)/python tests/safety/fuzz.py --fresh --seconds 16
	$(BIN)/python tests/safety/fuzz_runs.py --inputs 60

# Wheel and sdist, built, looked into, installed where nothing else is, on the oldest and the newest Python, and used.
package: $(PACKING)
	.venv-package/bin/python tests/packaging/check_package.py

$(PACKING): tests/packaging/requirements.txt
	$(PYTHON) -m venv .venv-package
	.venv-package/bin/python -m pip install --quiet --disable-pip-version-check -r tests/packaging/requirements.txt
	touch $@

# Executes the notebooks anew, with their figures: four minutes.
notebook: $(READY)
	$(BIN)/python tests/docs/notebook.py examples/*.ipynb

# The compiled loops that are kept; they are checked against their source, so this only frees disk space.
clean-cache:
	rm -f src/fracid/__pycache__/*.nb? src/fracid/*/__pycache__/*.nb?
