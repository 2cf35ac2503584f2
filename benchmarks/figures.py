"""The page of figures, from the results that the other benchmarks keep: python -m benchmarks.figures

Writes the tables of docs/figures.md and of the two pages that continue it, whose text is written by hand, and the two
pictures that no other benchmark draws.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.cases import ENGINES, QUANTITIES, title
from benchmarks.engines import read, thousands
from benchmarks.pages import DOCS, rewrite, table
from benchmarks.pictures import NUMBA, OURS, PINOCCHIO
from benchmarks.readme_picture import CALLS, COLORS, HESSIANS, METHODS
from rne.plotting.plots import blank_figure

PAGES = (DOCS / "figures.md", DOCS / "figures-accuracy.md", DOCS / "figures-growth.md")
RUNS = {  # places of the page: the file of results, and the command that measures and draws them
    "chart-run": ("charts.json", "python -m benchmarks"),
    "engines-run": ("kernels.json", "python -m benchmarks.kernels"),
    "differences-run": ("validation.json", "python -m benchmarks.validation"),
    "families-run": ("stability.json", "python -m benchmarks.stability"),
    "growth-run": ("charts.json", "python -m benchmarks --only growth"),
    "scenes-run": ("charts.json", "python -m benchmarks --only scenes"),
    "chaos-run": ("stability.json", "python -m benchmarks.stability"),
}
BATCHES = {"single": "one state", "small": "batch of {small}", "batch": "batch of {states}"}  # by key in the results
LOOKS = {"numpy": (OURS, "s"), "numba": (NUMBA, "o")}
DECADES = [0.1, 1, 10, 100]
COMPARED = ["inverse dynamics", "mass matrix", "gravity", "bias", "forward dynamics"]
SLID = "slid joint origins"  # a family of robots whose errors are those of reading their file
Results = dict[str, Any]


def tables() -> dict[str, str]:
    """By the name of their place in the page."""
    charts = read("charts.json")["charts"]
    runs = {place: run(*source) for place, source in RUNS.items()}
    runs["chart-run"] += "\n\nHessians: " + run("derivatives.json", "python -m benchmarks.derivatives")
    return {
        **runs,
        "chart": of_chart(charts, read("derivatives.json")),
        "engines": of_engines(read("kernels.json")),
        "differences": of_differences(read("validation.json")),
        "families": of_families(read("stability.json")["evaluation"]),
        "growth": of_growth(charts["growth"]["chains"]),
        "chaos": of_chaos(read("stability.json")["simulation"]["chaos"]),
    }


def run(name: str, command: str) -> str:
    """Command, machine and date of a file of results."""
    found = read(name)
    machine, date = found["machine"], found["date"]
    versions = ", ".join(f"{package} {machine[package]}" for package in ("python", "numpy", "pin"))
    where = f"{machine['cpu']}, {machine['cores']} cores, {versions}"
    return f"*Measured by* `{command}` *on* {date}: {where}; kept in `benchmarks/results/{name}`."


def of_chart(charts: Results, derivatives: Results) -> str:
    """Time and error of each package: states and Hessians of the UR5, and its free swing at the middle tolerance."""
    rows = charts["evaluation"]["robots"]["ur5"]["inverse_dynamics"]
    second = derivatives["robots"]["ur5 inverse_dynamics"]
    runs = charts["integration"]["drift-10"]["robots"]["ur5"]["runs"]
    lines = []
    for who in COLORS:
        line = [who, *_time_and_error(rows.get(CALLS.get(who))), *_time_and_error(second.get(HESSIANS.get(who)))]
        way, method = METHODS.get(who, (None, None))
        swing = [one for one in runs if one["method"] == method and way in one["seconds"]][1:2]
        cells = [
            [f"{method}, {one['setting']}", f"{1e3 * one['seconds'][way]:.3g}", f"{one['errors'][way]:.1e}"]
            for one in swing
        ]
        lines.append([*line, *(cells or [["-"] * 3])[0]])
    head = ["package", "ns per state", "error", "ns per Hessian", "error", "swing by", "ms", "energy drift [J]"]
    return table(head, lines)


def _time_and_error(row: Results | None) -> list[str]:
    return ["-", "-"] if row is None else [f"{row['ns_per_state']:.0f}", f"{row['worst_error']:.1e}"]


def ratios(found: Results, engine: str, size: str) -> dict[str, float]:
    """Times faster than Pinocchio, by "robot, quantity"; below 1 is slower."""
    values = {}
    for robot, quantities in found["robots"].items():
        for quantity in QUANTITIES:
            own = quantities[quantity].get(engine)
            if own:
                single = size == "single"
                ratio = 1 / own["single_times_slower"][0] if single else own[f"{size}_times_faster"][0]
                values[f"{robot}, {title(quantity)}"] = ratio
    return values


def of_engines(found: Results) -> str:
    """Median and range over robots and quantities."""
    head = ["times faster than Pinocchio", *(_size(found, size) for size in BATCHES)]
    lines = [[name, *(_range(ratios(found, e, size).values()) for size in BATCHES)] for e, name in ENGINES.items()]
    return table(head, lines)


def _size(found: Results, size: str) -> str:
    return BATCHES[size].format(small=thousands(found["small"]), states=thousands(found["states"]))


def _range(values: Iterable[float]) -> str:
    ordered = sorted(values)
    return f"{ordered[0]:.2g} to {ordered[-1]:.2g}" if ordered else "-"


def engines_picture(found: Results) -> Any:
    """A panel for each size of batch; a row for each robot and quantity."""
    figure = blank_figure(9, 4.8)
    panels = figure.subplots(1, len(BATCHES), sharex=True, sharey=True)
    for ax, size in zip(panels, BATCHES, strict=True):
        for engine, (color, marker) in LOOKS.items():
            values = ratios(found, engine, size)
            ax.plot(list(values.values()), list(values), marker, color=color, label=f"rne, {ENGINES[engine]}")
        ax.axvline(1, color=PINOCCHIO, label="Pinocchio")
        ax.set(xscale="log", title=_size(found, size), xlim=(0.08, 125))
        ax.set_xticks(DECADES, [f"{x:g}" for x in DECADES])
        ax.grid(True, alpha=0.25)
    figure.supxlabel("times faster than Pinocchio [1]", fontsize="medium")
    panels[0].invert_yaxis()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)
    return figure


def differences(found: Results) -> dict[str, list[float]]:
    """Relative differences from Pinocchio, by quantity, one for each robot, the smallest first."""
    three = {name: errors for name, errors in found["worst"].items() if not name.startswith("worst of")}
    robots = (found["robots"] | three).values()
    return {quantity: sorted(robot[quantity] for robot in robots if quantity in robot) for quantity in COMPARED}


def of_differences(found: Results) -> str:
    """Median and largest of each quantity."""
    lines = [[q, str(len(x)), f"{x[len(x) // 2]:.1e}", f"{x[-1]:.1e}"] for q, x in differences(found).items()]
    return table(["quantity", "robots", "median difference", "largest"], lines)


def differences_picture(found: Results) -> Any:
    """For each quantity the share of robots whose difference is no larger."""
    figure = blank_figure(8, 4.2)
    ax = figure.subplots()
    for quantity, values in differences(found).items():
        share = [(k + 1) / len(values) for k in range(len(values))]
        ax.step(values, share, where="post", label=quantity)
    ax.axvline(2.2e-16, color="0.4", linestyle=":", label="float64, one rounding")
    ax.set(xscale="log", xlabel="largest difference from Pinocchio, relative [1]", ylabel="share of the robots [1]")
    ax.grid(True, alpha=0.25)
    ax.legend(loc="lower right", fontsize="small")
    return figure


def of_families(rows: list[Results]) -> str:
    """The largest error of each way to compute a quantity, over n eps times the condition, and where it occurs."""
    lines = []
    for method in dict.fromkeys(row["method"] for row in rows):
        mine = [row for row in rows if row["method"] == method and row["family"] != SLID]
        worst = max(mine, key=lambda row: row["ratio"] / row["n"])
        lines.append([method, f"{worst['ratio'] / worst['n']:.2g}", worst["family"]])
    return table(["method", "largest error / (n eps condition)", "family"], lines)


def of_growth(chains: Results) -> str:
    """Times faster than Pinocchio for the shortest and the longest of the chains."""
    lines = []
    for kind, lengths in chains.items():
        for quantity in QUANTITIES:
            there = [n for n in lengths if quantity in lengths[n]]
            ends = [f"{lengths[n][quantity]['times_faster'][0]:.2g}, {n} joints" for n in (there[0], there[-1])]
            lines.append([kind, title(quantity), *ends])
    return table(["chain", "quantity", "times faster than Pinocchio: shortest", "longest"], lines)


def of_chaos(chaos: Results) -> str:
    """Duration for which the positions of a free swing can be trusted."""
    lines = [[tolerance, f"{one['horizon']:.1f}"] for tolerance, one in chaos.items()]
    return table(["rtol of DOP853", "error below 1e-3 rad until [s]"], lines)


def main() -> None:
    rewrite(tables(), *PAGES)
    pictures = {
        "engines": engines_picture(read("kernels.json")),
        "differences": differences_picture(read("validation.json")),
    }
    for name, figure in pictures.items():
        figure.savefig(DOCS / "pictures" / f"{name}.png", facecolor="white")


if __name__ == "__main__":
    main()
