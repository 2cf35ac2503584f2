"""Compare many random scenes: python -m tests.fuzz COUNT [START [ENGINE]]."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import collections
import sys
import time

from .comparison import check


def main(count, start=0, engine="numpy"):
    """Print every case that fails, and a summary."""
    kinds, reasons, begun = collections.Counter(), collections.Counter(), time.process_time()
    count = int(count)
    for seed in range(int(start), int(start) + count):
        outcome = check(seed, engine=engine)
        kinds[outcome.kind] += 1
        if outcome.kind == "failed":
            print(f"# seed {seed}: {outcome.words}\n{outcome.script}", flush=True)
        elif outcome.kind != "compared":
            reasons[f"{outcome.kind}: {outcome.words}"] += 1
    for reason, times in reasons.most_common(40):
        print(f"{times:5d} {reason}")
    per_case = (time.process_time() - begun) / count
    print(", ".join(f"{times} {kind}" for kind, times in kinds.items()), f"({per_case:.2f} s CPU per case)")


if __name__ == "__main__":
    main(*sys.argv[1:])
