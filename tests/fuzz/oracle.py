"""The motion of a case, integrated from event to event with Pinocchio's dynamics. Shares no code with rne.simulation.

Events are found by looking at many points of every step.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

from .dynamics import Dynamics, IllPosed
from .plant import coordinates

NODES, FEWEST = 12, 4  # intervals of the longest and of short steps at whose ends events are looked for
LONGEST, SMOOTH = 1 / 100, 1 / 30  # of the duration: longest step with and without events; none is stepped over
MAX_EVENTS = 3000
HUGE = 1e3  # [rad, m, rad/s, m/s]: beyond, the motion has diverged
SLACK = 1e-10  # of static friction, and of the largest load: above dynamics.HELD, so that a held joint is not overloaded at once


class Motion(NamedTuple):
    """Positions and rates at the times of the case's grid up to the end, and the energies there."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    energies: np.ndarray  # work of the drives, dissipated by viscous and by Coulomb friction, shape (T, 3)
    kinetic: np.ndarray
    z: np.ndarray  # states of a controller that is not sampled, shape (T, states)
    status: int
    end: float
    joint: int  # that reached its stop, or -1


def motion(case, tol):
    """The motion by DOP853 at relative tolerance `tol`."""
    return Integration(case, tol).run()


class Integration(Dynamics):
    """One run; `changes` counts those of the modes of dry friction."""

    def __init__(self, case, tol):
        super().__init__(case)
        self.tol = tol
        self.begin = 0.0  # of the span
        self.rows, self.changes = [], 0
        self._set_stops()

    def _set_stops(self):
        """Rows (joint, A, b): A q + b is negative beyond the stop."""
        G, o = coordinates(self.case)
        self.stops = []
        for k, joint in enumerate(self.case.joints):
            if self.case.stops and G[k].any():
                ends = ((-1.0, joint.upper), (1.0, joint.lower))
                self.stops += [(k, sign * G[k], sign * (o[k] - bound)) for sign, bound in ends if np.isfinite(bound)]

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
        longest = LONGEST * self.case.duration
        inner = np.linspace(begin, end, int(np.clip(np.ceil(NODES * (end - begin) / longest), FEWEST, NODES)) + 1)
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
                    lambda s: self._margin(k, s, dense),
                    bounds=(t[j - 1], t[j + 1]),
                    method="bounded",
                    options={"xatol": 1e-13},
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
        self.begin, forced = t, None
        for _ in range(MAX_EVENTS):
            if self.dry:
                self.settle(t, x, forced, jump=t == self.begin)
            t, x, event = self.segment(t, end, x)
            if event is None:
                return end, x, -1
            if event < len(self.stops):
                self.record(t, x)
                return t, x, self.stops[event][0]
            self.changes += 1
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
        if self.held is not None and not self.mode.any():
            return self.rest(end, x)
        longest = (LONGEST if watched else SMOOTH) * self.case.duration
        first = min(longest, end - t) if self.held is not None and t == self.begin else None
        solver = DOP853(self.rates, t, x, end, rtol=self.tol, atol=1e-2 * self.tol, max_step=longest, first_step=first)
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
        return end, solver.y.copy(), None

    def rest(self, end, x):
        """All joints stick under held torques: nothing changes."""
        grid = self.case.grid
        for time in grid[(grid > self.begin) & (grid <= end)]:
            self.record(time, x)
        return end, x, None

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
        z = X[:, 2 * n : -3] if self.case.sample_time is None else X[:, :0]
        return Motion(t, q, qd, X[:, -3:], kinetic, z, status, end, joint)
