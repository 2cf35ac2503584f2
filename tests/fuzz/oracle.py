"""The motion of a case, integrated from event to event with Pinocchio's dynamics. Shares no code with rne.simulation.

The modes of dry friction are found by trying all combinations; events by looking at many points of every step.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

from .laws import law_of
from .plant import Plant, coordinates

NODES = 12  # intervals of a step at whose ends events are looked for
LONGEST = 1 / 100  # of the duration: longest step with events
MAX_CALLS = 150_000  # of the right-hand side: more is a loop that is unstable or chatters
MAX_EVENTS = 3000
HUGE = 1e3  # [rad, m, rad/s, m/s]: beyond, the motion has diverged
HELD = 1e-11  # of the largest load: rounding error of loads and accelerations in the choice of modes
SLACK = 1e-10  # of static friction, and of the largest load: above HELD, so that a held joint is not overloaded at once


class IllPosed(Exception):
    """The case has no unique motion that can be computed: it diverges, chatters, or its modes are ambiguous."""


class Motion(NamedTuple):
    """Positions and rates at the times of the case's grid up to the end, and the energies there."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    energies: np.ndarray  # work of the drives, dissipated by viscous and by Coulomb friction, shape (T, 3)
    kinetic: np.ndarray
    status: int
    end: float
    joint: int  # that reached its stop, or -1


def motion(case, tol):
    """The motion by DOP853 at relative tolerance `tol`."""
    return _Integration(case, tol).run()


class _Integration:
    def __init__(self, case, tol):
        self.case, self.tol = case, tol
        self.plant = Plant(case)
        self.n = n = self.plant.n
        self.law, self.states = law_of(case)
        limit = np.inf if case.torque_limit is None else np.array(case.torque_limit)
        self.limit = np.broadcast_to(limit, (n,))
        self._set_friction(case.friction or {})
        self._set_stops()
        self.mode = np.ones(n, dtype=int)
        self.held = None
        self.span = (0.0, case.duration)
        self.calls = 0
        self.rows = []
        self.first_step = None

    def _set_friction(self, friction):
        def sizes(name, default):
            value = friction.get(name)
            return np.broadcast_to(np.array(default if value is None else value, dtype=float), (self.n,))

        self.viscous = sizes("viscous", 0.0)
        self.viscous_back = sizes("viscous_back", self.viscous)
        self.coulomb = sizes("coulomb", 0.0)
        self.coulomb_back = sizes("coulomb_back", self.coulomb)
        self.static, self.static_back = sizes("static", self.coulomb), sizes("static", self.coulomb_back)
        self.smoothing = friction.get("smoothing", 0.01)
        self.dry = self.smoothing == 0
        self.sticky = self.dry & (np.maximum(self.static, self.static_back) > 0)

    def _set_stops(self):
        """Rows (joint, A, b): A q + b is negative beyond the stop."""
        G, o = coordinates(self.case)
        self.stops = []
        for k, joint in enumerate(self.case.joints):
            if self.case.stops and G[k].any():
                ends = ((-1.0, joint.upper), (1.0, joint.lower))
                self.stops += [(k, sign * G[k], sign * (o[k] - bound)) for sign, bound in ends if np.isfinite(bound)]

    # Right-hand side

    def drives(self, t, x):
        """Torques within their limits, and dz/dt; held ones if the controller is sampled."""
        n = self.n
        z = x[2 * n : 2 * n + self.states]
        if self.held is not None:
            return self.held, 0 * z
        inside = min(max(t, self.span[0]), self.span[1])
        u, rates = self.law(inside, x[:n], x[n : 2 * n], z)
        return np.minimum(np.maximum(u, -self.limit), self.limit), rates

    def forces(self, t, x):
        """M, the torques without dry friction, those of the drives, of viscous and of smoothed friction, and dz/dt."""
        n = self.n
        q, qd = x[:n], x[n : 2 * n]
        u, rates = self.drives(t, x)
        viscous = np.where(qd < 0, self.viscous_back, self.viscous) * qd
        smooth = np.zeros(n)
        if not self.dry and self.smoothing:
            smooth = np.where(qd < 0, self.coulomb_back, self.coulomb) * np.tanh(qd / self.smoothing)
        return self.plant.mass_matrix(q), u - self.plant.bias(q, qd) - viscous - smooth, u, viscous, smooth, rates

    def accelerate(self, M, net, mode):
        """Accelerations under the modes, and the loads of all joints beside M qdd."""
        slips = mode != 0
        net = net - np.where(mode > 0, self.coulomb, -self.coulomb_back) * (slips & self.dry & self.sticky)
        if slips.all():
            return np.linalg.solve(M, net), np.zeros(self.n)
        qdd = np.zeros(self.n)
        if slips.any():
            qdd[slips] = np.linalg.solve(M[np.ix_(slips, slips)], net[slips])
        return qdd, net - M @ qdd

    def rates(self, t, x):
        """dx/dt of (q, qd, z, work, viscous, Coulomb)."""
        self.calls += 1
        if self.calls > MAX_CALLS:
            raise IllPosed("too many calls")
        n = self.n
        qd = x[n : 2 * n]
        M, net, u, viscous, coulomb, z_rates = self.forces(t, x)
        qdd, _ = self.accelerate(M, net, self.mode)
        if self.dry:
            coulomb = np.where(self.mode > 0, self.coulomb, -self.coulomb_back)
        return np.concatenate([qd, qdd, z_rates, [u @ qd, viscous @ qd, coulomb @ qd]])

    # Modes

    def settle(self, t, x, forced=None):
        """Modes of the joints at rest: the consistent combination in which most stick; `forced` (joint, mode) slips."""
        qd = x[self.n : 2 * self.n]
        self.mode = np.where(self.sticky, np.sign(qd), 1).astype(int)
        resting = np.flatnonzero(self.sticky & (qd == 0))
        if not len(resting):
            return
        M, net, *_ = self.forces(t, x)
        choices = [(forced[1],) if forced and forced[0] == k else (0, 1, -1) for k in resting]
        combinations = sorted(itertools.product(*choices), key=np.count_nonzero)
        found = []
        for combination in combinations:
            if found and np.count_nonzero(combination) > np.count_nonzero(found[0][resting]):
                break
            mode = self.mode.copy()
            mode[resting] = combination
            if self._is_consistent(M, net, mode, resting):
                found.append(mode)
        if len(found) != 1:
            raise IllPosed(f"{len(found)} combinations of modes")
        self.mode = found[0]

    def _is_consistent(self, M, net, mode, resting):
        qdd, load = self.accelerate(M, net, mode)
        small = HELD * np.abs(net).max()
        holds = (load <= self.static + small) & (load >= -self.static_back - small)
        starts = qdd * mode >= -HELD * np.abs(qdd).max()
        return np.where(mode == 0, holds, starts)[resting].all()

    # Events: margins that become negative

    def margins(self, t, X):
        """Values of all events at times t, shape (events, T); states X of shape (size, T)."""
        n = self.n
        rows = [A @ X[:n] + b for _, A, b in self.stops]
        rows += [self.mode[k] * X[n + k] + 10 * self.tol for k in self._slipping()]
        stuck = np.flatnonzero(self.mode == 0)
        if len(stuck):
            loads = np.array([self._loads(s, x) for s, x in zip(t, X.T, strict=True)])
            for k in stuck:
                rows += [self.static[k] + loads[:, n] - loads[:, k], self.static_back[k] + loads[:, n] + loads[:, k]]
        return np.array(rows).reshape(-1, len(t))

    def _loads(self, t, x):
        """Loads of the sticking joints, and behind them the slack."""
        M, net, *_ = self.forces(t, x)
        load = self.accelerate(M, net, self.mode)[1]
        return np.append(load, SLACK * np.abs(net).max())

    def _slipping(self):
        return np.flatnonzero(self.sticky & (self.mode != 0))

    def first_event(self, dense, begin, end):
        """(index, time) of the first event inside a step, or None."""
        inner = np.linspace(begin, end, NODES + 1)
        near = 1e-3 * (inner[1] - inner[0])
        t = np.concatenate([[begin, begin + near], inner[1:-1], [end - near, end]])
        values = self.margins(t, dense(t))
        found = []
        for k, row in enumerate(values):
            bracket = self._bracket(k, t, row, dense)
            if bracket is not None:
                at = brentq(lambda s: self._margin(k, s, dense), *bracket, xtol=1e-15)  # noqa: B023
                found.append((at, k))
        return min(found)[::-1] if found else None

    def _margin(self, k, t, dense):
        return self.margins(np.array([t]), dense(np.array([t])))[k, 0]

    def _bracket(self, k, t, row, dense):
        for j in range(len(t) - 1):
            if row[j] > 0 >= row[j + 1]:
                return t[j], t[j + 1]
            is_dip = j > 0 and row[j - 1] >= row[j] <= row[j + 1] and row[j] > 0
            if is_dip and row[j] < max(row[j - 1] - row[j], row[j + 1] - row[j]):
                low = minimize_scalar(
                    lambda s: self._margin(k, s, dense), bounds=(t[j - 1], t[j + 1]), method="bounded", options={"xatol": 1e-13}
                )
                if low.fun < 0:
                    return t[j - 1], low.x
        return None

    # Integration

    def run(self):
        """From sample to sample, or from break to break."""
        case, T = self.case, self.case.sample_time
        x = np.concatenate([case.q0, case.qd0, np.zeros(self.states + 3)])
        self.record(0.0, x)
        if T is not None:
            count = int(np.ceil(case.duration / T * (1 - 1e-12)))
            edges = [*(k * T for k in range(count)), case.duration]
        else:
            switch = case.law.get("time") if case.law and case.law["kind"] == "switch" else None
            edges = [0.0, *([switch] if switch and switch < case.duration else []), case.duration]
        for begin, end in itertools.pairwise(edges):
            self.span = (np.nextafter(begin, np.inf), np.nextafter(end, -np.inf))
            if T is not None:
                x = self.sample(begin, x)
            t, x, joint = self.integrate(begin, end, x)
            if joint >= 0:
                return self.finish(1, t, joint)
        return self.finish(0, case.duration, -1)

    def sample(self, t, x):
        """Compute the torques to hold, and step the controller's states by Euler's rule."""
        n, T, rate, before = self.n, self.case.sample_time, self.case.torque_rate, self.held
        z = x[2 * n : 2 * n + self.states]
        u, rates = self.law(t, x[:n], x[n : 2 * n], z)
        u = np.minimum(np.maximum(u, -self.limit), self.limit)
        if rate is not None and before is not None:
            step = np.array(rate) * T
            u = np.minimum(np.maximum(u, before - step), before + step)
        self.held = u
        return np.concatenate([x[: 2 * n], z + T * rates, x[2 * n + self.states :]])

    def integrate(self, t, end, x):
        """To the end of the span, over changes of mode; the joint that reached its stop, or -1."""
        forced = None
        for _ in range(MAX_EVENTS):
            if self.dry:
                self.settle(t, x, forced)
            t, x, event = self.segment(t, end, x)
            if event is None:
                return end, x, -1
            if event < len(self.stops):
                self.record(t, x)
                return t, x, self.stops[event][0]
            slipping, stuck = self._slipping(), np.flatnonzero(self.mode == 0)
            event -= len(self.stops)
            forced = None
            if event < len(slipping):
                x[self.n + slipping[event]] = 0.0
            else:
                event -= len(slipping)
                forced = stuck[event // 2], 1 - 2 * (event % 2)
        raise IllPosed("too many changes of mode")

    def segment(self, t, end, x):
        """To the next event, or the end of the span."""
        watched = bool(self.stops) or self.sticky.any()
        if watched:
            at_once = np.flatnonzero(self.margins(np.array([t]), x[:, None])[:, 0] <= 0)
            if len(at_once):
                return t, x.copy(), int(at_once[0])
        longest = LONGEST * self.case.duration if watched else np.inf
        first = None if self.first_step is None or self.sticky.any() else min(self.first_step, longest, end - t)
        solver = DOP853(
            self.rates, t, x, end, rtol=self.tol, atol=1e-2 * self.tol, max_step=longest, first_step=first
        )
        while solver.status == "running":
            solver.step()
            if solver.status == "failed" or not np.abs(solver.y[: 2 * self.n]).max() < HUGE:
                raise IllPosed("diverges")
            grid = self.case.grid
            due = grid[(grid > solver.t_old) & (grid <= solver.t)]
            if watched or len(due):
                dense = solver.dense_output()
                event = self.first_event(dense, solver.t_old, solver.t) if watched else None
                for time in due[due <= (event[1] if event else solver.t)]:
                    self.record(time, dense(time))
                if event:
                    return event[1], dense(event[1]), event[0]
        if self.case.sample_time is not None:
            self.first_step = max(solver.h_abs, end - t)
        return end, solver.y.copy(), None

    def record(self, t, x):
        """Keep the state at one time, once."""
        if not self.rows or t > self.rows[-1][0]:
            self.rows.append((t, x.copy()))

    def finish(self, status, end, joint):
        """The recorded states as a Motion."""
        n = self.n
        t, X = np.array([row[0] for row in self.rows]), np.array([row[1] for row in self.rows])
        q, qd = X[:, :n], X[:, n : 2 * n]
        kinetic = np.array([0.5 * b @ self.plant.mass_matrix(a) @ b for a, b in zip(q, qd, strict=True)])
        return Motion(t, q, qd, X[:, -3:], kinetic, status, end, joint)
