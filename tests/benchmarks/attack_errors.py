"""Searches for a level that is farther from the model than it says, in models made to be nasty, until the time is up.

    python tests/benchmarks/attack_errors.py [--seconds 3600] [--seed 0] [--points 20]

Prints the number of each model whose hierarchy is at fault, and what is, and ends with 1 then:
`nasty_model(numpy.random.default_rng([SEED, NUMBER]))` makes it again.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.jobs.nasty_models import built_of, faults, nasty_model


def main() -> None:
    """Attack for the time that is given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--points", type=int, default=20, help="of each drawable in each direction, about")
    arguments = parser.parse_args()
    began, told, number, failed = time.monotonic(), 0.0, 0, 0
    while (passed := time.monotonic() - began) < arguments.seconds:
        model = nasty_model(np.random.default_rng([arguments.seed, number]))
        with tempfile.TemporaryDirectory() as folder:
            found = faults(model, built_of(model, Path(folder)), number, arguments.points)
        if found:
            failed += 1
            print(f"model {number} of seed {arguments.seed}: {'; '.join(found)}", flush=True)
        number += 1
        if passed - told > 60:
            told = passed
            print(f"{passed:.0f} of {arguments.seconds:.0f} s: {number:,} models, {failed} at fault", flush=True)
    print(f"{number:,} models, {time.monotonic() - began:.0f} s, {failed} at fault")
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
