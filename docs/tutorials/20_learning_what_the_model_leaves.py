"""
Learning the residuals of a model
=================================

An IRB 140 carries an unknown load, and its gears have friction. How large are the
residuals of the model's torques, and can a network learn them? In JAX the model's
torques are a layer of the loss. The load's mass and centre, which enter the rigid-body
equations, and small networks for the friction, which has no known equation, are learned
together.

Needs: ``pip install '.[plot,numba,jax]'``
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("irb140")
rng = np.random.default_rng(0)

# %%
# Measurements
# ------------
# The measured robot is simulated, with a load, with friction that decreases as the
# velocity rises from zero (Stribeck effect), and with noise.

real = robot.with_payload(3.0, [0.05, 0.0, 0.12], link="link_6")
strength = np.array([8.0, 10.0, 7.0, 2.0, 2.0, 1.0])  # [N m]


def friction(qd):
    falling = 0.7 + 0.5 * np.exp(-((qd / 0.3) ** 2))
    return strength * (falling * np.tanh(qd / 0.1) + 0.2 * qd)


def measured():
    """States in 10 s of a random motion, five sines for each joint, and its torques."""
    t = np.linspace(0, 10, 500)[:, None, None]
    w = 2 * np.pi * np.arange(1, 6)[:, None] / 10
    a, phase = rng.normal(0, 0.3, (5, 6)), rng.uniform(0, 2 * np.pi, (5, 6))
    q = (a * np.sin(w * t + phase)).sum(1)
    qd = (a * w * np.cos(w * t + phase)).sum(1)
    qdd = (-a * w**2 * np.sin(w * t + phase)).sum(1)
    tau = real.inverse_dynamics(q, qd, qdd) + friction(qd)
    return q, qd, qdd, tau + rng.normal(0, 0.02 * strength, q.shape)


train = [np.concatenate(a) for a in zip(*(measured() for _ in range(4)))]
test = measured()

# %%
# The model as a function of JAX
# ------------------------------
# With ``parameters=True`` the ten inertial parameters of each body are an argument. XLA
# calls the kernel's machine code; ``jax.grad`` gets derivatives with respect to states
# and parameters from the gradient kernel. The load is a point mass m at c, added to the
# last body's mass, moments m c and moments of inertia, in the order of
# ``Robot.parameters``.

function, options = rne.dynamics.inverse_dynamics, {"parameters": True}
torques = rne.compile(function, robot.model, engine="numba", **options).to_jax()


def with_load(load):
    m, x, y, z = load[0], *load[1:]
    inertia = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    ten = m * jnp.stack([jnp.ones(()), x, y, z, *inertia])
    return jnp.asarray(robot.parameters).at[-10:].add(ten)


# %%
# The networks
# ------------
# The friction of a joint depends on its own speed: one network per joint, with one
# hidden layer. Speed is the only input, so that the networks cannot fit torques of the
# load.

start = {
    "load": jnp.array([0.5, 0.0, 0.0, 0.05]),  # [kg], [m]
    "in": jnp.asarray(rng.normal(0, 6, (6, 16))),
    "bias": jnp.asarray(rng.normal(0, 1, (6, 16))),
    "out": jnp.zeros((6, 16)),
}


def network(p, qd):
    return (p["out"] * jnp.tanh(p["in"] * qd[..., None] + p["bias"])).sum(-1) * strength


def loss(p, q, qd, qdd, tau):
    rest = tau - torques(q, qd, qdd, with_load(p["load"])) - network(p, qd)
    return ((rest / strength) ** 2).mean()


# %%
# Learning
# --------
# Adam (Kingma and Ba 2015), written out; 3000 steps on 256 states each.


def step(state, k):
    p, m, v = state
    rows = jax.random.randint(jax.random.key(k), (256,), 0, len(train[0]))
    slopes = jax.grad(loss)(p, *(jnp.asarray(a)[rows] for a in train))
    m = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, m, slopes)
    v = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, v, slopes)
    rate = 0.01 * 0.1 ** (k / 3000)
    scaled = rate * jnp.sqrt(1 - 0.999 ** (k + 1)) / (1 - 0.9 ** (k + 1))
    p = jax.tree.map(lambda p, m, v: p - scaled * m / (jnp.sqrt(v) + 1e-8), p, m, v)
    return (p, m, v), loss(p, *train)


zeros = jax.tree.map(jnp.zeros_like, start)
(found, *_), history = jax.lax.scan(step, (start, zeros, zeros), jnp.arange(3000))
print(
    f"loss: {history[0]:.3f} at first, {history[-1]:.5f} at last; noise {0.02**2:.5f}"
)
print("load [kg, m]:", np.round(found["load"], 3))
assert history[-1] < 3 * 0.02**2
np.testing.assert_allclose(found["load"], [3.0, 0.05, 0.0, 0.12], atol=0.05)

# %%
# On a motion that was not learned
# --------------------------------
# The root mean squares of the residuals [N m], joint by joint.

q, qd, qdd, tau = test
plain = tau - robot.inverse_dynamics(q, qd, qdd)
loaded = tau - np.asarray(torques(q, qd, qdd, with_load(found["load"])))
learned = loaded - np.asarray(network(found, qd))
rows = {"model": plain, "with load": loaded, "with networks": learned}
for name, rest in rows.items():
    print(f"{name:14}", np.sqrt((rest**2).mean(0)).round(2))
print(f"{'noise':14}", 0.02 * strength)
assert ((learned**2).mean(0) < (0.05 * strength) ** 2).all()

# %%
# Beyond the speeds of the data the networks are not valid; the load is valid for every
# motion.

figure = Figure(figsize=(9, 3.4), layout="constrained")
curves, rests = figure.subplots(1, 2)
speeds = np.linspace(-3, 3, 601)[:, None] * np.ones(6)
curves.plot(speeds[:, :4], network(found, speeds)[:, :4], label=robot.joint_names[:4])
curves.plot(speeds[:, :4], friction(speeds)[:, :4], "k:", linewidth=1)
curves.set(title="friction, true: dotted", xlabel="speed [rad/s]", ylabel="[N m]")
curves.legend(frameon=False)
for name, rest in rows.items():
    rests.plot(np.linspace(0, 10, 500), rest[:, 1], label=name, linewidth=1)
rests.set(title="left of joint 2's torque [N m]", xlabel="time [s]", ylim=(-29, 19))
rests.legend(frameon=False, ncols=3, loc="upper center", fontsize="small")
figure
