"""Searches for a drawable that the visibility engine misses, in scenes made to be nasty, until the time is up.

    python tests/benchmarks/attack_visibility.py [--seconds 3600] [--seed 0] [--rays 3000] [--method METHOD]

Prints the number of each scene in which rays in double precision see what is not reported, and ends with 1 then:
`nasty_scene(numpy.random.default_rng([SEED, NUMBER]))` makes it again.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from jobs.visibility.settings import METHODS
from tests.jobs.visibility.nasty import misses, nasty_scene


def main() -> None:
    """Attack for the time that is given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rays", type=int, default=3000)
    parser.add_argument("--method", choices=METHODS, default=METHODS[0])
    arguments = parser.parse_args()
    began, told, number, failed = time.monotonic(), 0.0, 0, 0
    while (passed := time.monotonic() - began) < arguments.seconds:
        attack = nasty_scene(np.random.default_rng([arguments.seed, number]))
        attack = attack._replace(settings=replace(attack.settings, method=arguments.method))
        missed = misses(attack, arguments.rays, number)
        if missed:
            failed += 1
            print(f"scene {number} of seed {arguments.seed}: misses {missed}", flush=True)
        number += 1
        if passed - told > 60:
            told = passed
            print(f"{passed:.0f} of {arguments.seconds:.0f} s: {number:,} scenes, {failed} with a miss", flush=True)
    print(
        f"{number:,} scenes, {number * arguments.rays:,} rays, {time.monotonic() - began:.0f} s, {failed} with a miss"
    )
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
