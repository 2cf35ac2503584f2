"""Kernels of both engines compared with Pinocchio: python -m benchmarks.kernels [--quick]

Operations, time per state in batches and in single calls, and the error of the very same calls against long double;
Pinocchio in the same interleaved run, one thread each. Writes benchmarks/results/kernels.json.
"""

from __future__ import annotations

from typing import Any

from benchmarks.cases import (
    ENGINES,
    FREE_FINGERS,
    QUANTITIES,
    compiled_by_numba,
    engines,
    engines_left_out,
    load,
    title,
)
from benchmarks.kernel_errors import large_angles
from benchmarks.kernel_growth import growth, processes, start_up
from benchmarks.kernel_runs import SMALL, Robots, Sizes, compare
from benchmarks.measure import QUICK_NOTE, is_quick, write
from benchmarks.pages import table, three

ROBOTS = ("irb140", "ur5", "panda", FREE_FINGERS)
DERIVATIVES = "inverse_dynamics_derivatives"
COUNT, REPEATS = 100_000, 9
QUICK_COUNT, QUICK_REPEATS = 2000, 1

Results = dict[str, Any]


def run(quick: bool) -> Results:
    """All figures."""
    everything, compiled = (*QUANTITIES, DERIVATIVES), compiled_by_numba(quick)
    taken = {engine: compiled if quick and engine == "numba" else everything for engine in engines()}
    sizes = Sizes(QUICK_COUNT if quick else COUNT, QUICK_REPEATS if quick else REPEATS, taken)
    first = {engine: start_up(engine) for engine in taken}
    found: Results = {"states": sizes.count, "small": SMALL, "repeats": sizes.repeats}
    found |= {"engines_left_out": engines_left_out(), "robots": {}, "large_angles": {}}
    for name in ROBOTS[:1] if quick else ROBOTS:
        robots = {engine: load(name, engine) for engine in taken}
        found["robots"][name] = compare(robots, sizes)
        found["large_angles"][name] = angles_of(robots, sizes)
    sole = ("numpy",) if quick else taken
    found["growth"] = {engine: {"start_up_s": first[engine]} | growth(engine, quick) for engine in sole}
    found["two_processes"] = processes(20_000 if quick else 2_000_000, 1 if quick else 5)
    return found


def angles_of(robots: Robots, sizes: Sizes) -> Results:
    """The errors of large angles of the quantities in which all engines take part."""
    taken = {quantity: sizes.of(robots, quantity) for quantity in QUANTITIES}
    return {quantity: large_angles(r, quantity) for quantity, r in taken.items() if len(r) == len(robots)}


def tables(results: Results) -> dict[str, str]:
    """Every table, by its title."""
    found = {
        f"Relative to Pinocchio, batches of {results['states']} and {results['small']}": evaluations(results),
        "Derivatives of inverse dynamics, Pinocchio's in a loop": of_derivatives(results),
        "Worst error of angles up to a size, relative to each state's largest entry [eps]": of_angles(results),
        "Compiling, the size of batches (inverse dynamics of the irb140), memory": of_growth(results),
    }
    return {name: text for name, text in found.items() if text}


def evaluations(results: Results) -> str:
    """A row for each robot, quantity and engine, and for Pinocchio."""
    head = ["robot", "quantity", "by", "operations", "error, batch [eps]", "one state [eps]", "batch, ns per state"]
    head += ["times Pinocchio's speed", f"batch of {results['small']}, ns per state", "times Pinocchio's speed"]
    head += ["float32, times float64's speed", "two threads, times one's speed", "one state [µs]"]
    head += ["times Pinocchio's time", "to trace and compile [s]"]
    lines = []
    for robot, quantities in results["robots"].items():
        for quantity in QUANTITIES:
            row = quantities[quantity]
            there = [engine for engine in ENGINES if engine in row]
            lines += [[robot, title(quantity), *our_cells(row, engine)] for engine in there]
            lines.append([robot, title(quantity), *their_cells(row["pinocchio"])])
    return table(head, lines)


def our_cells(row: Results, engine: str) -> list[str]:
    """An engine's."""
    own = row[engine]
    build = sum(own[part] for part in ("trace_s", "compile_single_s", "compile_batch_s"))
    return [
        ENGINES[engine],
        str(row["operations"]),
        f"{own['error_eps']:.1f}",
        f"{own['single_error_eps']:.1f}",
        f"{own['ns_per_state']:.0f}",
        three(own["batch_times_faster"]),
        f"{own['small_ns_per_state']:.0f}",
        three(own["small_times_faster"]),
        f"{own['float32_times_faster'][0]:.2f}",
        f"{own['two_threads_times_faster'][0]:.2f}",
        f"{own['single_us']:.2f}",
        three(own["single_times_slower"]),
        f"{build:.2f}",
    ]


def their_cells(own: Results) -> list[str]:
    """Pinocchio's."""
    threads = f"{own['two_threads_times_faster'][0]:.2f}" if "two_threads_times_faster" in own else "-"
    times = [f"{own[key]:.0f}" for key in ("ns_per_state", "small_ns_per_state")]
    return ["Pinocchio", "-", "-", "-", times[0], "-", times[1], "-", "-", threads, f"{own['single_us']:.2f}", "-", "-"]


def of_derivatives(results: Results) -> str:
    """A row for each robot and engine."""
    head = ["robot", "by", "operations", "one state [µs]", "times Pinocchio's time", "batch, ns per state"]
    lines = []
    for robot, quantities in results["robots"].items():
        row = quantities[DERIVATIVES]
        for engine in (e for e in ENGINES if e in row):
            own = row[engine]
            single = [f"{own['single_us']:.2f}", three(own["single_times_slower"])]
            batch = [f"{own['ns_per_state']:.0f}", three(own["batch_times_faster"])]
            lines.append([robot, ENGINES[engine], str(row["operations"]), *single, *batch])
    return table([*head, "times Pinocchio's speed"], lines)


def of_angles(results: Results) -> str:
    """A row for each robot, quantity and size of the angles; empty without Numba."""
    if len(engines_in(results)) < 2:
        return ""
    head = ["robot", "quantity", "angles up to [rad]", "NumPy, batch", "Numba, batch", "Numba's / NumPy's"]
    head += ["NumPy, one state", "Numba, one state", "Numba's / NumPy's"]
    lines = []
    for robot, quantities in results["large_angles"].items():
        for quantity, rows in quantities.items():
            for row in rows:
                cells = []
                for way in ("batch", "single"):
                    plain, machine = row["numpy"][way], row["numba"][way]
                    cells += [f"{plain:.2g}", f"{machine:.2g}", f"{machine / plain:.2f}"]
                lines.append([robot, title(quantity), f"{row['angle']:.3g}", *cells])
    return table(head, lines)


def of_growth(results: Results) -> str:
    """A row for each engine."""
    grown = results["growth"]
    sizes = list(next(iter(grown.values()))["ns_per_state"])
    joints = next(iter(grown.values()))["chain_joints"]
    head = ["by", "first kernel of a process [s]", "three kernels of the irb140 [s]", f"a chain of {joints} joints [s]"]
    head += [*(f"ns per state of {size}" for size in sizes), "extra memory [MB]"]
    lines = []
    for engine, own in grown.items():
        seconds = [f"{own[key]:.2f}" for key in ("start_up_s", "compile_three_s", "compile_chain_s")]
        times = [f"{own['ns_per_state'][size]:.0f}" for size in sizes]
        lines.append([ENGINES[engine], *seconds, *times, f"{own['peak_extra_MB']:.1f}"])
    return table(head, lines)


def engines_in(results: Results) -> list[str]:
    """The engines that took part."""
    return [engine for engine in ENGINES if any(engine in r["mass_matrix"] for r in results["robots"].values())]


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    for name, text in tables(results).items():
        print(f"{name}:\n\n{text}\n")
    print(f"Two processes are {three(results['two_processes'])} times faster than one.")
    for name, reason in results["engines_left_out"].items():
        print(f"{name} is left out: {reason}.")
    if quick:
        print(f"\n{QUICK_NOTE}")
    else:
        write("kernels.json", results)


if __name__ == "__main__":
    main()
