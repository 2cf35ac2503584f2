r"""
The compiled engine
===================

The dynamics of a robot run as NumPy calls or, with ``engine="numba"``, as machine code.
Which is faster depends on how many states you compute. This tutorial measures it on the
machine that runs it, and shows that both give the same numbers up to rounding.

Needs: ``pip install '.[plot,numba]'``
"""

from time import perf_counter

import numpy as np
from matplotlib.figure import Figure

import rne

plain = rne.load("irb140")
compiled = rne.load("irb140", engine="numba")
print("engines:", plain.engine, "and", compiled.engine)

# %%
# What is compiled when
# ---------------------
# Nothing is compiled so far. Each quantity is compiled at its first call, once for
# single states and once for batches, for this robot. (The very first call of a robot
# for one state runs the recursion as it is written, and the second one runs the kernel.
# Here we call the kernel itself.) The code lives as long as the kernel. A copy stays on
# disk for later processes; ``rne cache`` shows where. The first call takes longer than
# later ones, because it includes compiling or loading.
#
# The first simulation on a machine takes longest. Numba then translates the loops of
# the solvers, 4 s for a swing and about 10 s for all kinds of scenes. Later processes
# find them on the disk. For a message, set ``logging.basicConfig(level="INFO")``.

rng = np.random.default_rng(0)
q, qd, qdd = rng.uniform(-1, 1, (3, 100_000, 6)) * [[[np.pi]], [[2.0]], [[10.0]]]


def seconds(call, repeats=3):
    """Shortest time of some calls [s]."""
    times = []
    for _ in range(repeats):
        begin = perf_counter()
        call()
        times.append(perf_counter() - begin)
    return min(times)


kernels = {
    robot.engine: robot.kernel(rne.dynamics.inverse_dynamics)
    for robot in (plain, compiled)
}
calls = {
    "one state": (q[0], qd[0], qdd[0]),
    "a batch": (q[:100], qd[:100], qdd[:100]),
}
compiling = {}
for name, states in calls.items():
    compiling[name] = first = seconds(lambda: kernels["numba"](*states), 1)
    again = seconds(lambda: kernels["numba"](*states))
    print(f"{name}: first call {first:.2f} s, later ones {again * 1e6:.0f} us")

# %%
# The same numbers
# ----------------
# Both engines run the same list of operations. They may differ in the last digits,
# because their instructions round sines, and products with a sum, differently. We
# measure the difference in spacings of floating-point numbers at each state's largest
# torque. States whose torques nearly cancel show larger numbers.

by_numpy, by_numba = (robot.inverse_dynamics(q, qd, qdd) for robot in (plain, compiled))
units = abs(by_numba - by_numpy).max(axis=1) / np.spacing(abs(by_numpy).max(axis=1))
median, largest = np.median(units), units.max()
print(f"units in the last place: median {median:.0f}, largest {largest:.0f}")
assert median <= 2
assert largest <= 1000

# %%
# How many states make it worth while?
# ------------------------------------
# Each NumPy call costs a microsecond or so, however few states it works on. A batch
# spreads that cost. Machine code has no such cost. With ``workers``, threads share a
# batch: machine code runs in parallel, NumPy's calls mostly do not.

sizes = 10 ** np.arange(6)


def first_states(N):
    """The first N states; a single one as shape (6,), faster than a batch of one."""
    return (q[0], qd[0], qdd[0]) if N == 1 else (q[:N], qd[:N], qdd[:N])


per_state = {
    name: [seconds(lambda: kernel(*first_states(N))) / N for N in sizes]
    for name, kernel in kernels.items()
}
with_workers = [
    seconds(lambda: kernels["numba"](*first_states(N), workers=2)) / N
    for N in sizes[3:]
]

figure = Figure(figsize=(7, 4), layout="constrained")
ax = figure.subplots()
for name, times in per_state.items():
    ax.loglog(sizes, 1e6 * np.array(times), "o-", label=name)
ax.loglog(sizes[3:], 1e6 * np.array(with_workers), "s--", label="numba, two workers")
ax.set(xlabel="states in a call", ylabel="time per state [µs]")
ax.set_title("inverse dynamics of the IRB 140")
ax.grid(alpha=0.3)
ax.legend(frameon=False)
figure

# %%
# Compiling happens once. It pays off after compile time / (time per state with NumPy -
# time per state with Numba) states:

gain = per_state["numpy"][-1] - per_state["numba"][-1]
if gain > 0:
    print(f"compiling is won back after {compiling['a batch'] / gain:.0e} states")

# %%
# Simulations and ensembles
# -------------------------
# The engine belongs to the robot. Robots and scenes that you derive from it keep it,
# and their whole equations of motion are compiled. Ensembles gain most, because their
# steps are compiled as well. Robots that differ only in numbers, such as those of one
# arm with many payloads, share the code. For everything that takes less than a second
# with NumPy, compiling does not pay.

starts = q[:500, :3] / 4
runs = {}
for robot in (plain, compiled):
    arm = robot.locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
    first = seconds(lambda: rne.ensemble(arm, starts, 0 * starts, 0.1, step=2e-3), 1)
    runs[robot.engine] = rne.ensemble(arm, starts, 0 * starts, 0.1, step=2e-3)
    again = seconds(lambda: rne.ensemble(arm, starts, 0 * starts, 0.1, step=2e-3), 1)
    print(f"{robot.engine}: 500 swings, {first:.2f} s at first, {again:.2f} s then")
difference = abs(runs["numba"].q - runs["numpy"].q).max()
print(f"largest difference of the positions: {difference:.0e} rad")
assert difference < 1e-11
