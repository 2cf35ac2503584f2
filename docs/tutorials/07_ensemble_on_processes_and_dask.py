r"""
Ensemble on processes and Dask
==============================

The power fails. The brakes of a UR5 need 0.3 s to close (we assume), and until then the
arm falls freely. How far does the flange drop? We do not know posture and velocities at
that moment exactly, so we draw 2000 of them and simulate them all: in this process, on
two processes, and on a Dask cluster. All three give the same bits.

Needs: ``pip install '.[plot,robots,cluster]'``
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from matplotlib.figure import Figure

import rne

# %%
# The scene and the starts
# ------------------------
# Without a controller the drives give no torque. Only friction slows the fall; its
# coefficients are assumed. The starts are normally distributed about a working posture.
# The seed makes them the same in every run.

robot = rne.load("ur5").with_payload(3.0, link="tool0")
friction = rne.Friction(viscous=[15, 15, 10, 2, 2, 2])  # [N m s/rad]
scene = rne.Scene(robot, friction=friction)

rng = np.random.default_rng(1)
posture = np.deg2rad([0, -45, 70, -25, -90, 0])
q0 = posture + np.deg2rad(5) * rng.normal(size=(2000, 6))
qd0 = 0.3 * rng.normal(size=(2000, 6))  # [rad/s]


def fall(executor=None):
    return rne.ensemble(scene, q0, qd0, 0.3, keep=31, executor=executor)


# %%
# One process
# -----------
# ``ensemble`` moves all initial states together. Each motion has its own steps, so that
# the error of each step stays within ``rtol`` and ``atol``. A run at a hundredth of the
# tolerance shows the accumulated error. ``keep`` is the number of times that are
# stored.
#
# Everything from here on is under ``if __name__ == "__main__":``. The processes of a
# pool import this file, and must not start pools themselves. They need only the lines
# above.

if __name__ == "__main__":
    falls = fall()
    finer = rne.ensemble(scene, q0, qd0, 0.3, rtol=1e-8, atol=1e-11)
    error = abs(finer.q[-1] - falls.q[-1]).max()
    print(
        f"{len(q0)} motions, {falls.evaluations} evaluations of the equations of motion"
    )
    print(f"a finer tolerance changes the positions by at most {error:.1e} rad")
    assert error < 1e-4

# %%
# Two processes
# -------------
# Any executor of ``concurrent.futures`` can run the parts of an ensemble. Each process
# traces the equations of motion once. No motion depends on its neighbours, so the
# results are equal to the last bit, however you divide the work. Two processes pay off
# for longer runs than this one.

if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        on_processes = fall(pool)
    print("two processes, same bits:", np.array_equal(on_processes.q, falls.q))
    assert np.array_equal(on_processes.q, falls.q)
    assert np.array_equal(on_processes.qd, falls.qd)

# %%
# Dask
# ----
# You can pass a Dask client as it is. Here the cluster is two threads of this process,
# and its status pages are for this machine only. With the address of a scheduler,
# ``Client("tcp://...")``, the same lines run on a real cluster. Its machines need the
# same versions of rne and NumPy.

if __name__ == "__main__":
    from distributed import Client, LocalCluster

    pages = dict.fromkeys(
        ["dashboard_address", "worker_dashboard_address"], "127.0.0.1:0"
    )
    cluster = LocalCluster(n_workers=1, threads_per_worker=2, processes=False, **pages)
    with cluster, Client(cluster) as client:
        on_dask = fall(client)
    print("Dask, same bits:", np.array_equal(on_dask.q, falls.q))
    assert np.array_equal(on_dask.q, falls.q)

# %%
# The answer
# ----------
# ``rne.plotting.quantile_plot`` draws the bands between quantiles of the joints' positions.

if __name__ == "__main__":
    figure = rne.plotting.quantile_plot(
        falls, ["shoulder_lift_joint", "elbow_joint", "wrist_1_joint"]
    )

# %%
# One call gives the height of the flange for all motions and times.

if __name__ == "__main__":
    height = robot.link_poses(falls.q)[:, :, robot.link_names.index("tool0"), 2, 3]
    drop = 1e3 * (height[0] - height)  # times, motions [mm]
    levels = np.quantile(drop, [0.05, 0.25, 0.5, 0.75, 0.95], axis=1)
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    ax = figure.subplots()
    ax.fill_between(
        falls.t,
        levels[0],
        levels[4],
        color="C0",
        alpha=0.2,
        label="90 % of the motions",
    )
    ax.fill_between(falls.t, levels[1], levels[3], color="C0", alpha=0.4, label="50 %")
    ax.plot(falls.t, levels[2], color="C0", label="median")
    ax.plot(
        falls.t,
        500 * -robot.model.gravity[2] * falls.t**2,
        "k:",
        label="a body in free fall",
    )
    ax.set(xlabel="time since the power failed [s]", ylabel="drop of the flange [mm]")
    ax.legend(frameon=False)
    for level, value in zip((5, 50, 95), levels[[0, 2, 4], -1]):
        print(f"{level:2} % of the motions drop less than {value:5.0f} mm")

# %%
# A quantile estimated from 2000 motions is itself uncertain. To see by how much, draw
# motions anew from the 2000 (the bootstrap).

if __name__ == "__main__":
    again = rng.integers(0, 2000, (500, 2000))
    spread = np.quantile(drop[-1][again], 0.95, axis=1).std()
    print(f"standard error of the 95 % quantile: {spread:.1f} mm")
