"""Dry friction: every joint slips forwards, slips backwards or sticks, and events lead from one to another.

A sticking joint is held at rest by whatever torque that takes, up to its static friction; a slipping one is resisted
by its Coulomb friction, and sticks or turns round when its rate passes through zero. Which of several joints at rest
break away is found one by one, the most overloaded first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .friction import Friction
from .plant import Plant
from .smooth import stop_message, tolerances
from .solvers import FAILURES, watched
from .spatial import Array
from .trajectory import Run, Task

MOST_EVENTS = 100_000
AT_REST = 1e-12  # rad/s: a joint at an event


class DryPlant:
    """The right-hand side for given modes of the joints: +1 and -1 slip, 0 sticks."""

    def __init__(self, plant: Plant, friction: Friction) -> None:
        n = plant.robot.n
        self.plant, self.friction, self.n = plant, friction, n
        self.forward = np.broadcast_to(np.asarray(friction.coulomb, dtype=float), (n,))
        self.back = np.broadcast_to(np.asarray(friction.coulomb_back, dtype=float), (n,))
        self.mode = np.zeros(n, dtype=int)

    def loads(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """M, the net torque without dry friction, and the torque of the drives."""
        n, robot, rhs = self.n, self.plant.robot, self.plant.rhs
        q, qd = x[:n], x[n : 2 * n]
        drives, _ = rhs.drives(np.array([t]), x, self.plant.torque(t, x))
        u = np.zeros(n) if drives is None else np.asarray(drives)
        net = u - robot.bias_torque(q, qd) - np.asarray(self.friction.viscous_torque(qd))
        return robot.mass_matrix(q), net, u

    def accelerations(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """Accelerations, the friction each joint has (what a sticking one needs), and the drives' torques."""
        M, net, u = self.loads(t, x)
        slips = self.mode != 0
        dry = np.where(self.mode > 0, self.forward, -self.back) * slips
        qdd = np.zeros(self.n)
        if slips.any():
            qdd[slips] = np.linalg.solve(M[np.ix_(slips, slips)], (net - dry)[slips])
        needed = net - M @ qdd
        return qdd, np.where(slips, dry, needed), u

    def static(self, direction: Array) -> Array:
        """What a joint at rest can resist, pushed in a direction."""
        if self.friction.static is not None:
            return np.broadcast_to(np.asarray(self.friction.static, dtype=float), (self.n,))
        return np.where(direction > 0, self.forward, self.back)

    def settle(self, t: float, x: Array, overloaded: Sequence[int] = ()) -> None:
        """Modes of the joints from their rates; of those at rest, the overloaded ones break away."""
        qd = x[self.n : 2 * self.n]
        moving = np.where(np.abs(qd) > AT_REST, np.sign(qd), 0).astype(int)
        for i in overloaded:  # at this very instant, which rounding may place on either side
            moving[i] = int(np.sign(self.accelerations(t, x)[1][i]))
        self.mode = moving
        for _ in range(self.n):
            _, needed, _ = self.accelerations(t, x)
            excess = np.where(self.mode == 0, np.abs(needed) - self.static(needed), -np.inf)
            worst = int(np.argmax(excess))
            if not excess[worst] > 1e-9 * max(1.0, float(np.abs(needed).max())):
                return
            self.mode[worst] = int(np.sign(needed[worst]))

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt, with the rates of sticking joints at zero."""
        self.plant.evaluations += 1
        n = self.n
        qd = np.where(self.mode != 0, x[n : 2 * n], 0.0)
        qdd, dry, u = self.accelerations(t, np.concatenate([x[:n], qd, x[2 * n :]]))
        powers = {"drives": u @ qd, "viscous": self.friction.viscous_torque(qd) @ qd, "coulomb": dry @ qd}
        own = self.plant.rhs.own_states
        rates = [qd, qdd]
        if own:
            _, z_rates = self.plant.rhs.drives(np.array([t]), x, None)
            rates.append(np.asarray(z_rates))
        return np.concatenate([*rates, [powers[name] for name in self.plant.rhs.ledger]])

    def events(self) -> list[Callable[[float, Array], float]]:
        """A slipping joint comes to rest; a sticking one is overloaded."""
        return [self._rest(i) if self.mode[i] else self._overload(i) for i in range(self.n)]

    def _rest(self, i: int) -> Callable[[float, Array], float]:
        sign = float(self.mode[i])

        def rate(t: float, x: Array) -> float:
            return sign * float(x[self.n + i])

        rate.terminal, rate.direction = True, -1.0  # type: ignore[attr-defined]
        return rate

    def _overload(self, i: int) -> Callable[[float, Array], float]:
        def margin(t: float, x: Array) -> float:
            needed = self.accelerations(t, x)[1]
            return float(self.static(needed)[i] - abs(needed[i]))

        margin.terminal, margin.direction = True, -1.0  # type: ignore[attr-defined]
        return margin


def stick_slip_run(plant: Plant, task: Task, failures: list[tuple[float, str]]) -> Run:
    """From event to event until the end, a stop or a failure, which is added to `failures`."""
    from scipy.integrate import solve_ivp

    friction = plant.rhs.friction
    assert friction is not None
    dry = DryPlant(plant, friction)
    rtol, atol = tolerances(plant, task)
    method, duration, t_eval, stops = task.method, task.duration, task.t_eval, task.events
    if method in ("Radau", "BDF"):
        raise ValueError(f"`method` of a scene whose joints stick must not need a Jacobian, got {method!r}; take LSODA")
    edges = [*sorted({b for b in task.breaks if 0 < b < duration}), duration]
    t, x, times, states = 0.0, task.x0.copy(), [np.zeros(0)], [np.zeros((0, len(task.x0)))]
    n, ending = plant.robot.n, ""
    overloaded: list[int] = []
    slopes: list[Array] = []
    for count in range(MOST_EVENTS):
        try:
            dry.settle(t, x, overloaded)
            end = next(edge for edge in edges if edge > t)
            inside = None if t_eval is None else t_eval[(t_eval >= t) & (t_eval <= end)]
            solution = solve_ivp(
                dry,
                (t, end),
                x,
                method=watched(method, failures, [x]),
                rtol=rtol,
                atol=atol,
                dense_output=True,
                events=[*dry.events(), *stops],
            )
        except FAILURES as error:
            failures.append((t, str(error)))
            break
        t_new = float(solution.t[-1])
        picked = solution.t[:-1] if inside is None else inside[inside < t_new]
        if len(picked):
            times.append(np.asarray(picked))
            states.append(np.asarray(solution.sol(picked)).T)
            slopes += [dry.accelerations(float(s), y)[0] for s, y in zip(picked, states[-1], strict=True)]
        t, x = t_new, np.array(solution.y[:, -1])
        overloaded = _come_to_rest(dry, solution, x)
        hit = [k for k, when in enumerate(solution.t_events or ()) if len(when) and k >= n]
        if failures or hit or t >= duration:
            ending = f"{count} changes between sticking and slipping"
            if hit:
                ending = stop_message(stops[hit[0] - n], t, plant.robot.joint_names)
            break
    else:
        failures.append((t, f"more than {MOST_EVENTS} changes between sticking and slipping"))
    if t_eval is None or (len(t_eval) and t_eval[-1] == t):  # the last instant itself
        times.append(np.array([t]))
        states.append(x[None])
        slopes.append(dry.accelerations(t, x)[0])
    status = 1 if "stop" in ending else 0
    return Run(np.concatenate(times), np.concatenate(states), status, ending, None, np.array(slopes).reshape(-1, n))


def _come_to_rest(dry: DryPlant, solution: Any, x: Array) -> list[int]:
    """At an event the rate that passes through zero is zero; returns the sticking joints that broke away."""
    happened = [i for i, when in enumerate((solution.t_events or ())[: dry.n]) if len(when)]
    for i in happened:
        x[dry.n + i] = 0.0
    x[dry.n : 2 * dry.n][dry.mode == 0] = 0.0
    return [i for i in happened if dry.mode[i] == 0]
