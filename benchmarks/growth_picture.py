"""Chart C's picture: time per state, operations, compile time and errors against the number of joints."""

from __future__ import annotations

from typing import Any

from benchmarks.cases import QUANTITIES, title
from benchmarks.pictures import OURS, PINOCCHIO
from rne.plotting.plots import blank_figure

LINES = {"straight": "-", "crooked": "--"}
COLORS = dict(zip(QUANTITIES, (OURS, "#2f8a4a", "#7d4bb0"), strict=True))
TICKS = (2, 6, 12, 24, 48, 100)


def picture(results: dict[str, Any]) -> Any:
    """Six panels with log scales."""
    chains = results["chains"]
    figure = blank_figure(9.2, 11.5)
    grid = figure.subplots(3, 2)
    axes = grid.T.reshape(2, 3)
    figure.suptitle("Growth with the number of joints n (log scales)")
    for ax, quantity in zip(axes[0], QUANTITIES, strict=True):
        times(ax, chains, quantity, results["batch"])
    growth(axes[1, 0], chains, "operations", "operations per state [1]")
    growth(axes[1, 1], chains, "compile_s", "time to trace, allocate and run once [s]")
    axes[1, 0].set_title("rne: operations")
    axes[1, 1].set_title("rne: compile time")
    ticks = [n for n in TICKS if n <= max(chains["straight"])]
    errors(axes[1, 2], chains)
    for ax in grid.flat:
        ax.set(xscale="log", yscale="log", xlabel="joints n [1]")
        ax.set_xticks(ticks, [str(n) for n in ticks], minor=False)
        ax.minorticks_off()
    axes[1, 1].set_ylim(1e-5, None)  # room for the legend
    for ax in grid.flat:
        ax.grid(True, alpha=0.25)
        if ax.get_legend() is None:
            ax.legend(fontsize="small", frameon=False)
    return figure


def times(ax: Any, chains: dict[str, Any], quantity: str, batch: int) -> None:
    """Time per state of one quantity, ours and Pinocchio's."""
    for family, style in LINES.items():
        rows = {n: row[quantity] for n, row in chains[family].items() if quantity in row}
        for who, key, color in (("rne", "ns_per_state", OURS), ("Pinocchio", "pinocchio_ns_per_state", PINOCCHIO)):
            values = [row[key] for row in rows.values()]
            ax.plot(list(rows), values, "." + style, color=color, label=f"{who}, {family} chain")
    calls = "one call per state" if quantity == "mass_matrix" else "batch call"
    ax.set(title=title(quantity), ylabel=f"time per state [ns], batch of {batch}")
    ax.legend(fontsize="small", frameon=False, title=f"Pinocchio: {calls}", title_fontsize="small")


def growth(ax: Any, chains: dict[str, Any], key: str, label: str) -> None:
    """One figure of all quantities."""
    for family, style in LINES.items():
        for quantity, color in COLORS.items():
            rows = {n: row[quantity][key] for n, row in chains[family].items() if quantity in row}
            rows = {n: value for n, value in rows.items() if value}
            ax.plot(list(rows), list(rows.values()), "." + style, color=color, label=f"{title(quantity)}, {family}")
    ax.set_ylabel(label)


def errors(ax: Any, chains: dict[str, Any]) -> None:
    """Errors of crooked chains, ours and Pinocchio's."""
    for quantity, color in COLORS.items():
        rows = {n: row[quantity] for n, row in chains["crooked"].items() if quantity in row}
        for who, key, style in (("rne", "error", ".-"), ("Pinocchio", "pinocchio_error", ".:")):
            ax.plot(
                list(rows), [row[key] for row in rows.values()], style, color=color, label=f"{who}, {title(quantity)}"
            )
    ax.set(title="errors, crooked chains", ylabel="worst error, relative to largest entry [1]", ylim=(1e-16, 1e-10))
    ax.legend(fontsize="small", frameon=False, loc="upper left")
