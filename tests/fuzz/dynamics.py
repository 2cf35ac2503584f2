"""The right-hand side of a case, and the modes of its joints under dry friction, by trying all combinations."""

from __future__ import annotations

import itertools

import numpy as np

from .laws import law_of
from .plant import Plant

MAX_CALLS = 150_000  # of the right-hand side: more is a loop that is unstable or chatters
HELD = 1e-11  # of the largest load: rounding error of loads and accelerations in the choice of modes


class IllPosed(Exception):
    """The case has no unique motion that can be computed: it diverges, chatters, or its modes are ambiguous."""


class Dynamics:
    """dx/dt of x = (q, qd, z, work, viscous, Coulomb), for given modes of the joints: +1 and -1 slip, 0 sticks."""

    def __init__(self, case):
        self.case = case
        self.plant = Plant(case)
        self.n = n = self.plant.n
        self.law, self.states = law_of(case)
        self.limit = np.broadcast_to(np.inf if case.effort_limit is None else np.array(case.effort_limit), (n,))
        self._set_friction(case.friction or {})
        self.mode = np.ones(n, dtype=int)
        self.held = None  # the torques of a sampled controller
        self.span = (0.0, case.duration)  # in which the law is evaluated, between its jumps
        self.calls = 0

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

    def settle(self, t, x, forced=None, *, jump=False):
        """Modes of the joints at rest; `forced` (joint, mode) slips, and `jump` tells that the torques may have jumped.

        Where static friction exceeds Coulomb friction several combinations can be consistent: a joint that is held
        could also slip. It is held as long as it can be: the combination in which fewest slip is taken, unless it
        is not the only such one, or two joints have broken away at once, or the others cannot be held at the moment
        when these break away.
        """
        qd = x[self.n : 2 * self.n]
        self.mode = np.where(self.sticky, np.sign(qd), 1).astype(int)
        resting = np.flatnonzero(self.sticky & (qd == 0))
        if not len(resting):
            return
        M, net, *_ = self.forces(t, x)
        found = []
        for combination in itertools.product(*[(0, 1, -1)] * len(resting)):
            mode = self.mode.copy()
            mode[resting] = combination
            fits = forced is None or mode[forced[0]] == forced[1]
            if fits and self._is_consistent(M, net, mode, resting):
                found.append(mode)
        found.sort(key=np.count_nonzero)
        if not found:
            raise IllPosed("no combination of modes")
        if len(found) > 1:
            self._examine(M, net, found, resting, jump)
        self.mode = found[0]

    def _examine(self, M, net, found, resting, jump):
        """Refuse a choice among several combinations that physics leaves open."""
        held, free = found[0], self.mode.copy()
        free[resting] = 0
        _, load = self.accelerate(M, net, free)
        overloaded = (load > self.static) | (load < -self.static_back)
        if np.count_nonzero(held) == np.count_nonzero(found[1]) or (jump and overloaded[resting].sum() > 1):
            raise IllPosed("several combinations of modes")
        starts = np.isin(np.arange(self.n), resting) & (held != 0)
        more = np.where(held > 0, self.static - self.coulomb, self.coulomb_back - self.static_back) * starts
        if not self._is_consistent(M, net - more, held, resting[held[resting] == 0]):
            raise IllPosed("held joints may break away with others")

    def _is_consistent(self, M, net, mode, resting):
        qdd, load = self.accelerate(M, net, mode)
        small = HELD * np.abs(net).max()
        holds = (load <= self.static + small) & (load >= -self.static_back - small)
        starts = qdd * mode >= -HELD * np.abs(qdd).max()
        return np.where(mode == 0, holds, starts)[resting].all()
