"""`make bench`: what the project costs, as figures that mean the same on any machine, beside those of earlier commits.

    python -m tests.benchmarks [--record] [--only stages|growth|large|runs]

One thread. `--record` appends the figures to `history.csv`, which is committed. Exits with 1 where one is slower than
the last three records. `bench_*.py` beside this file go deeper, each into one part.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch

from tests.benchmarks.measuring import Table
from tests.benchmarks.runs import runs
from tests.benchmarks.stages import against_plain, growth, large

PARTS = {"stages": against_plain, "growth": growth, "large": large, "runs": runs}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="append the figures to history.csv")
    parser.add_argument("--only", choices=PARTS, nargs="+", default=list(PARTS))
    options = parser.parse_args()
    torch.set_num_threads(1)
    table = Table()
    for part in options.only:
        PARTS[part](table)
    if options.record:
        commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
        table.record(time.strftime("%Y-%m-%d"), commit.stdout.strip())
    for name in table.slower():
        print(f"slower than before: {name}")
    return 1 if table.slower() else 0


if __name__ == "__main__":
    sys.exit(main())
