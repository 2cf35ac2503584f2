"""Faults planted in the torques of a robot: each by its cause, as a function of (q, qd, qdd)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import rne

from .helpers import point_mass_inertia


def planted(robot, seed=0):
    """Causes, a variant behind a slash, and the torques of a model that has this fault."""
    rng, model = np.random.default_rng(seed), robot.model
    tau = robot.inverse_dynamics
    return {
        **of_models(robot, rng),
        **of_conventions(robot, tau, rng),
        **of_torques(tau, robot.n, rng),
        **of_inertias(robot, rng),
        "none": rne.Robot(replace(model, name="the same")).inverse_dynamics,
    }


def planted_pair(robot, rng):
    """A fault of the model, and one of conventions or torques on top of it: both causes and the torques."""
    models = {**of_models(robot, rng), **of_inertias(robot, rng)}
    first = list(models)[int(rng.integers(len(models)))]
    others = {**of_conventions(robot, models[first], rng), **of_torques(models[first], robot.n, rng)}
    second = list(others)[int(rng.integers(len(others)))]
    return first, second, others[second]


def of_models(robot, rng):
    model = robot.model
    moved = np.array(model.link_body)
    tip = model.link_names[int(np.argmax(moved == moved.max()))]
    body = (0.02, -0.03, 0.1)
    heavier = np.where(np.arange(model.nb) == 1, 1.2, 1.0)
    models = {
        "gravity sign": replace(model, gravity=-model.gravity),
        "gravity missing": replace(model, gravity=0 * model.gravity),
        "gravity magnitude": replace(model, gravity=1.02 * model.gravity),
        "base turned": rne.model.mounted(model, [np.pi / 2, 0, 0]),
        "base turned/by any angle": rne.model.mounted(model, rng.uniform(0.2, 1, 3)),
        "payload": rne.model.with_payload(model, 2.5, com=body, link=tip),
        "payload/with inertia": rne.model.with_payload(
            model, 2.5, com=body, inertia=np.diag([0.01, 0.02, 0.015]), link=tip
        ),
        "one body": replace(model, mass=heavier * model.mass),
        "several bodies": replace(model, mass=rng.uniform(0.8, 1.2, model.nb) * model.mass),
    }
    return {cause: rne.Robot(replace(m, notes={})).inverse_dynamics for cause, m in models.items()}


def of_conventions(robot, tau, rng):
    n = robot.n
    i, j = rng.choice(np.arange(n), 2, replace=False)
    order = np.arange(n)
    order[[i, j]] = j, i
    sign = np.where(np.isin(np.arange(n), 1 + rng.choice(n - 1, 2, replace=False)), -1.0, 1.0)
    quarter, one, small = np.zeros(n), np.zeros(n), 0.05 * rng.standard_normal(n)
    quarter[1:3], one[2] = (-np.pi / 2, np.pi / 2), 0.3
    degree = np.where(robot.model.is_revolute[list(robot.model.independent_joints)], np.pi / 180, 1.0)

    def reordered(q, qd, qdd):
        torques = np.empty_like(q)
        torques[:, order] = tau(q[:, order], qd[:, order], qdd[:, order])
        return torques

    return {
        "joint order": reordered,
        "axis flipped": lambda q, qd, qdd: sign * tau(sign * q, sign * qd, sign * qdd),
        "joint zero": lambda q, qd, qdd: tau(q + quarter, qd, qdd),
        "joint zero/of one joint": lambda q, qd, qdd: tau(q + one, qd, qdd),
        "joint zero/of all joints": lambda q, qd, qdd: tau(q + small, qd, qdd),
        "angle unit": lambda q, qd, qdd: tau(degree * q, degree * qd, degree * qdd),
    }


def of_torques(tau, n, rng):
    k = int(rng.integers(n))
    flipped, other = np.ones(n), np.ones(n)
    flipped[k], other[k] = -1, 1.37
    size = rng.uniform(0.05, 0.5, n)
    return {
        "torque unit": lambda q, qd, qdd: 1000 * tau(q, qd, qdd),
        "torque sign": lambda q, qd, qdd: flipped * tau(q, qd, qdd),
        "torque factor": lambda q, qd, qdd: other * tau(q, qd, qdd),
        "armature": lambda q, qd, qdd: tau(q, qd, qdd) + size * qdd,
        "viscous friction": lambda q, qd, qdd: tau(q, qd, qdd) + 10 * size * qd,
        "Coulomb friction": lambda q, qd, qdd: tau(q, qd, qdd) + 10 * size * np.sign(qd),
        "friction": lambda q, qd, qdd: tau(q, qd, qdd) + 10 * size * np.sign(qd) + 4 * size * qd,
        "torque offset": lambda q, qd, qdd: tau(q, qd, qdd) + 5 * size,
    }


def of_inertias(robot, rng):
    """Those that the robot has products of inertia, or a body with unequal moments, for."""
    model, tau, I = robot.model, robot.inverse_dynamics, robot.model.inertia
    steiner = point_mass_inertia(model.mass[:, None, None], model.com - model.joint_origin)
    heavy = 1 + int(np.argmax(model.mass[1:]))
    slender = 1 + int(np.argmax([np.ptp(np.linalg.eigvalsh(x)) for x in I[1:]]))
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    Q *= np.linalg.det(Q)
    quarter = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    products = I * (1 - np.eye(3))

    def changed(change, bodies):
        pi = np.zeros((model.nb, 10))
        pi[bodies, 4:] = change[bodies][:, [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        return lambda q, qd, qdd: tau(q, qd, qdd) + robot.regressor(q, qd, qdd) @ pi.reshape(-1)

    every = np.arange(model.nb)
    found = {
        "inertia point": changed(steiner, every),
        "inertia point/of one body": changed(-steiner, [heavy]),
        "inertia axes": changed(Q @ I @ Q.T - I, [slender]),
        "inertia axes/by 90 deg": changed(quarter @ I @ quarter.T - I, [slender]),
    }
    if np.abs(products).max() > 1e-3 * np.abs(I).max():
        found["products of inertia"] = changed(-2 * products, every)
    return found
