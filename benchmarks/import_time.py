"""Time of `import rne` beside `import numpy`: python -m benchmarks.import_time [--quick]

Fresh processes of `python -c`, in turn; the third call also loads a robot, the last one imports all packages that a
plain installation brings. Writes benchmarks/results/import_time.json.
"""

from __future__ import annotations

import subprocess
import sys
from functools import partial

from benchmarks.measure import interleaved, is_quick, ratio, write

CODES = {
    "numpy": "import numpy",
    "rne": "import rne",
    "robot": "import rne; rne.load('irb140').inverse_dynamics([0] * 6, [0] * 6, [0] * 6)",
    "packages": "import numpy, scipy.integrate, scipy.optimize, lxml.etree",
}
REPEATS = 21
AT_MOST = 1.6  # import rne over import numpy


def main() -> None:
    quick = is_quick(__doc__)
    calls = {name: partial(subprocess.run, [sys.executable, "-c", code], check=True) for name, code in CODES.items()}
    seconds = interleaved(calls, 3 if quick else REPEATS)
    ratios = {name: ratio(seconds, name, "numpy") for name in CODES if name != "numpy"}
    for name, (median, low, high) in ratios.items():
        print(f"{CODES[name]}: {median:.2f} times the time of {CODES['numpy']} ({low:.2f} to {high:.2f})")
    print(f"the aim for {CODES['rne']} is at most {AT_MOST}")
    if not quick:
        write("import_time.json", {"codes": CODES, "seconds": seconds, "ratios": ratios})


if __name__ == "__main__":
    main()
