"""Makes the pictures of docs/control.md: laws that do not know the payload of 3 kg which the IRB 140 carries."""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rne

FOLDER = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
WIDTH = 5.0  # of the pictures [inch]: their text can be read on a phone
BELOW = {"loc": "outside lower center", "ncols": 2, "frameon": False}  # a legend
DURATION, PAYLOAD = 12.0, 3.0  # [s], [kg]
centre = np.array([0, 0.2, -0.3, 0.2, 0.8, 0.1])  # [rad]
radius = np.array([0.4, 0.3, 0.3, 0.4, 0.4, 0.5])  # [rad]
phase = np.array([0, np.pi / 2] * 3)


def circle(t):
    """Neighbouring joints run on circles at 0.5 Hz."""
    angle = np.pi * np.asarray(t) + phase
    return centre + radius * np.sin(angle), np.pi * radius * np.cos(angle), -(np.pi**2) * radius * np.sin(angle)


arm = rne.load("irb140")  # what the controllers know
cases, middle = [arm, arm.with_payload(PAYLOAD)], arm.with_payload(PAYLOAD / 2)
rate, kd = np.full(6, 20.0), np.array([40, 60, 20, 4, 2, 1.0])  # [1/s], [N m s/rad]
layer = 0.1 / np.sqrt(np.diag(middle.mass_matrix(circle(0)[0])))  # [rad/s]
rho = rne.control.uncertainty_bound(middle, cases, rate, layer, circle, 2.0)
learning = {"bodies": ["joint_6"], "gain": 30.0}
viscous, coulomb = np.array([10, 10, 5, 1, 0.5, 0.2]), np.array([4, 4, 2, 0.5, 0.3, 0.1])  # [N m s/rad], [N m]
friction = rne.Friction(viscous=viscous, coulomb=coulomb, smoothing=0.05)
half = {"viscous": viscous / 2, "coulomb": coulomb / 2, "smoothing": 0.05}

laws = {
    "computed torque": rne.control.computed_torque(arm, rate**2, 2 * rate, circle),
    "PD and gravity": rne.control.pd_gravity(arm, rate * kd, kd, circle),
    "adaptive": rne.control.adaptive(arm, kd, rate, circle, consistent=True, **learning),
    "robust": rne.control.robust(middle, rate, layer, circle, rho),
    "robust_passive": rne.control.robust_passive(cases, kd, rate, circle, boundary=0.3),
    "sliding_mode": rne.control.sliding_mode(cases, rate, layer, circle),
}
COLORS = {name: f"C{k}" for k, name in enumerate(laws)}
STYLES = {"robust": "--", "robust_passive": "-.", "sliding_mode": ":"}  # of torques that lie on each other
t = np.linspace(0, DURATION, 1201)


def run(law, **parts):
    scene = rne.Scene(arm, payload=PAYLOAD, controller=law, **parts)
    return rne.simulate(scene, *circle(0)[:2], DURATION, t_eval=t)


def error(motion):
    return np.abs(motion.q - circle(t[:, None])[0])


def largest(motion):
    """Largest error of any joint within the last quarter of a second [rad]."""
    worst = error(motion).max(axis=1)
    return np.array([worst[max(0, k - 25) : k + 1].max() for k in range(len(t))])


def save(figure, name):
    figure.savefig(FOLDER / f"control_{name}.png", dpi=160, facecolor="white")


def errors_figure(motions):
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    ax = figure.subplots()
    for name, motion in motions.items():
        ax.semilogy(t[1:], largest(motion)[1:], color=COLORS[name], label=name)
    ax.set(xlabel="time [s]", ylabel="largest error of a joint [rad]", xlim=(0, DURATION), ylim=(1e-4, 3))
    ax.grid(alpha=0.3)
    figure.legend(**BELOW)
    save(figure, "errors")


def bounds_figure(motions):
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    joints = np.arange(1, 7)
    for ax, name in zip(panels, ("robust", "robust_passive", "sliding_mode"), strict=True):
        ax.bar(joints, error(motions[name]).max(axis=0), color="0.65", width=0.6, label="largest error")
        ax.plot(joints, laws[name].error_bound, "k_", markersize=9, markeredgewidth=2, label="stated bound")
        ax.set(title=name, xlabel="joint", xticks=joints[::2], yscale="log", ylim=(1e-6, 1))
        ax.set_axisbelow(True)
        ax.grid(axis="y", alpha=0.3)
    panels[0].set_ylabel("error [rad]")
    figure.legend(*panels[0].get_legend_handles_labels(), **BELOW)
    save(figure, "bounds")


def torques_figure(motions):
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    shown = t <= 2
    for ax, joint in zip(panels, (1, 4), strict=True):
        for name, motion in motions.items():
            ax.plot(t[shown], motion.tau[shown, joint], color=COLORS[name], linestyle=STYLES.get(name, "-"), label=name)
        ax.set(ylabel=f"torque of joint {joint + 1} [N m]", xlim=(0, 2))
        ax.grid(alpha=0.3)
    panels[1].set_ylim(-2.2, 0.3)
    panels[1].set_xlabel("time [s]")
    figure.legend(*panels[0].get_legend_handles_labels(), **BELOW)
    save(figure, "torques")


def estimates_figure(motions):
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    mass, moment = figure.subplots(2, 1, sharex=True)
    constant = rne.control.adaptive(arm, kd, rate, circle, **learning)
    both = {"consistent": (laws["adaptive"], motions["adaptive"]), "constant metric": (constant, run(constant))}
    for color, (name, (law, motion)) in zip(("C2", "C6"), both.items(), strict=True):
        estimates = law.parameters(motion.controller_state)[:, -10:]
        mass.plot(t, estimates[:, 0], color=color, label=name)
        moment.plot(t, estimates[:, 3], color=color)
    truth = cases[1].parameters[-10:]
    for ax, value in ((mass, truth[0]), (moment, truth[3])):
        ax.axhline(value, color="black", linestyle="--", linewidth=0.8, label="link with payload")
        ax.grid(alpha=0.3)
    mass.set(ylabel="mass of link 6 [kg]", xlim=(0, DURATION), ylim=(0, 14))
    moment.set(ylabel="its first moment, z [kg m]", xlabel="time [s]")
    moment.set_ylim(bottom=0)
    mass.legend(frameon=False)
    save(figure, "estimates")


def friction_figure():
    figure = Figure(figsize=(WIDTH, 4.4), layout="constrained")
    ax = figure.subplots()
    learnt = rne.control.adaptive(arm, kd, rate, circle, consistent=True, **learning, **half)
    rubbing = {name: law for name, law in laws.items() if name not in ("computed torque", "PD and gravity")}
    for name, law in rubbing.items():
        ax.semilogy(t[1:], largest(run(law, friction=friction))[1:], color=COLORS[name], label=name)
    motion = run(learnt, friction=friction)
    ax.semilogy(t[1:], largest(motion)[1:], color="C6", label="adaptive, friction too")
    ax.set(xlabel="time [s]", ylabel="largest error of a joint [rad]", xlim=(0, DURATION), ylim=(1e-3, 1))
    ax.grid(alpha=0.3)
    figure.legend(**BELOW)
    save(figure, "friction")


if __name__ == "__main__":
    motions = {name: run(law) for name, law in laws.items()}
    errors_figure(motions)
    bounds_figure(motions)
    torques_figure(motions)
    estimates_figure(motions)
    friction_figure()
