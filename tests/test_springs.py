"""Springs: their torques are slopes of their energies, in every engine; closed forms; found again from measurements."""

import math
import pickle
import re

import mpmath
import numpy as np
import pytest

import rne
from rne.identification.diagnosis.residuals import FitResiduals
from rne.simulation.plant import Plant

from .helpers import first_joints, kept, relative, states
from .random_robots import random_tree

EPS = np.finfo(float).eps
GRAVITY = 9.81
GAS = rne.Spring("link_1", [-0.2, 0.0, 0.3], "link_2", [0.25, 0.12, 0.2], 9000, 0.45, force=300)
MANY = [
    GAS,
    rne.Spring("base_link", [0.1, 0.3, 0.9], "tool0", [0, 0, 0.1], 200, 0),
    rne.Spring("link_6", [0.1, 0, 0], "link_3", [0, 0.1, 0], 500, 0.2, force=-20, damping=40),
    rne.Spring.at_joint("joint_5", 30, -0.4, damping=2),
]


FEW = [
    *MANY[:2],
    rne.Spring("link_1", [0.1, 0, 0], "link_3", [0, 0.1, 0], 500, 0.2, force=-20, damping=40),
    rne.Spring.at_joint("joint_3", 30, -0.4, damping=2),
]


@pytest.fixture(scope="module")
def sprung(irb140):
    return rne.Scene(irb140, springs=MANY)


@pytest.fixture(scope="module")
def arm():
    return first_joints()


def pendulum(length=0.5, mass=2.0):
    """A point mass on a massless rod that hangs from the root link; the frame of `rod` is at the pivot."""
    return rne.Robot(
        rne.model.Model(
            name="pendulum",
            moving_joints=("swing",),
            joint_types=("revolute",),
            parent=(-1,),
            axis=[[0.0, 1.0, 0.0]],
            rotation=[np.eye(3)],
            translation=[[0.0, 0.0, 0.0]],
            mass=[mass],
            com=[[0.0, 0.0, -length]],
            inertia=np.zeros((1, 3, 3)),
            link_names=("wall", "rod"),
            link_body=(-1, 0),
            link_joints=(None, "swing"),
            link_rotation=[np.eye(3)] * 2,
            link_translation=np.zeros((2, 3)),
        )
    )


class TestTorques:
    def test_they_are_the_slope_of_the_energy(self, irb140):
        """By the complex step on the energy, whose text shares with that of the torques only where the ends are."""
        springs = rne.Scene(irb140, springs=MANY).resolved.springs
        q = states(6, 20)[0]
        for spring in springs.each:
            moved = q[:, None] + 1j * 1e-30 * np.eye(6)
            slopes = spring._energy(irb140.model, moved).imag / 1e-30
            assert relative(spring._elastic(irb140.model, q), slopes) <= 100 * EPS

    def test_a_force_alone_and_a_damper_alone_need_no_stiffness(self):
        """A push F supplies F dl/dq at every length; the drives must supply d dl/dt dl/dq against a damper.

        By the law of cosines l^2 = a^2 + r^2 - 2 a r cos(q) between points at a and r below the pivot.
        """
        a, r, F, d, q, qd = 0.9, 0.4, 30.0, 7.0, np.array([[0.4], [2.1]]), np.array([[0.5], [-1.5]])
        ends = ("wall", [0, 0, -a], "rod", [0, 0, -r])
        length = np.sqrt(a * a + r * r - 2 * a * r * np.cos(q))
        slope = a * r * np.sin(q) / length
        still = rne.Scene(pendulum(), gravity=[0, 0, 0]).inverse_dynamics(q, qd, 0 * qd)
        for more, expected in (({"force": F}, -F * slope), ({"damping": d}, d * slope * qd * slope)):
            scene = rne.Scene(pendulum(), gravity=[0, 0, 0], springs=[rne.Spring(*ends, **more)])
            assert relative(scene.inverse_dynamics(q, qd, 0 * qd) - still, expected) <= 100 * EPS
            motion = rne.simulate(scene, [0.4], [0.0], 0.5, rtol=1e-9)
            assert motion.energy_drift < 1e-7  # a hundred tolerances

    def test_damping_takes_power(self, irb140, sprung):
        """d l'^2 of each, l' being the slope of l along the motion."""
        q, qd, _ = states(6, 20)
        springs = sprung.resolved.springs
        _, damping = springs.torques(irb140.model, q, qd)
        rates = [s._stretch(irb140.model, q + 1e-30j * qd)[0].imag / 1e-30 for s in springs.each]
        power = sum(s.damping * rate**2 for s, rate in zip(springs.each, rates, strict=True))
        assert relative((damping * qd).sum(-1), power) <= 100 * EPS

    def test_forces_on_the_links_have_the_same_torques(self, irb140):
        """As external wrenches, by the recursion of forces, on which the loads of bearings depend."""
        q, qd, qdd = states(6, 20)
        springs = MANY[:2]
        scene = rne.Scene(irb140, springs=springs)
        external = scene.resolved.springs.wrenches(irb140, q)
        loaded = irb140.inverse_dynamics(q, qd, qdd, external=external)
        assert relative(scene.inverse_dynamics(q, qd, qdd), loaded) <= 200 * EPS

    def test_forward_dynamics_undo_inverse_dynamics(self, irb140, sprung):
        q, qd, qdd = states(6, 100)
        back = sprung.forward_dynamics(q, qd, sprung.inverse_dynamics(q, qd, qdd))
        assert relative(back, qdd) <= 50 * EPS * np.linalg.cond(irb140.mass_matrix(q)).max()

    @pytest.mark.parametrize("seed", kept(range(4), [1]))
    def test_on_trees_with_mimics(self, seed):
        """Between all pairs of links; torques of joints that mimic add to their coordinate."""
        tree = rne.Robot(random_tree(4, seed=seed, branching=0.4, mimics=2))
        rng = np.random.default_rng(seed)
        names = tree.link_names
        pairs = [(a, b) for k, a in enumerate(names) for b in names[:k]]
        springs = [rne.Spring(a, rng.normal(size=3), b, rng.normal(size=3), *rng.uniform(0, 9, 3)) for a, b in pairs]
        springs = [s for s in springs if any(s._bodies(tree.model))] + [
            rne.Spring.at_joint(tree.model.moving_joints[-1], 3, 1)
        ]
        found = rne.Scene(tree, springs=springs).resolved.springs
        q = states(tree.n, 5)[0]
        slopes = [
            np.sum([s._energy(tree.model, q + 1e-30j * e) for s in springs], 0).imag / 1e-30 for e in np.eye(tree.n)
        ]
        assert relative(found.torque(tree, q, 0 * q), np.stack(slopes, -1)) <= 500 * EPS

    def test_every_number_type(self, irb140):
        """Against 50 digits."""
        springs, (q, qd, _) = rne.Scene(irb140, springs=MANY).resolved.springs, states(6, 3)
        with mpmath.workdps(50):
            exact = springs.torque(irb140, *(np.vectorize(mpmath.mpf, otypes=[object])(x) for x in (q, qd)))
        for dtype, eps in ((np.float64, EPS), (np.float32, np.finfo(np.float32).eps), (np.longdouble, 1e-18)):
            found = springs.torque(irb140, q.astype(dtype), qd.astype(dtype))
            assert found.dtype == dtype
            rounding = 100 * eps if dtype != np.float32 else 1000 * eps  # q itself is rounded
            assert relative(found.astype(float), exact.astype(float)) <= max(rounding, EPS)

    def test_lists_and_single_states(self, irb140, sprung):
        zero = [0] * 6
        one = sprung.inverse_dynamics(zero, zero, zero)
        assert one.shape == (6,)
        again = [sprung.inverse_dynamics(zero, zero, zero) for _ in range(3)][-1]
        assert relative(again, one) <= 50 * EPS


class TestClosedForms:
    def test_pendulum_with_a_torsion_spring(self):
        """Small swings about its rest: the frequency is sqrt((k + m g l) / (m l^2))."""
        robot, k, m, l = pendulum(), 30.0, 2.0, 0.5
        scene = rne.Scene(robot, springs=[rne.Spring.at_joint("swing", k, 0.0)])
        q = np.linspace(-1, 1, 9)[:, None]
        torque = scene.inverse_dynamics(q, 0 * q, 0 * q)
        assert relative(torque, k * q + m * GRAVITY * l * np.sin(q)) <= 10 * EPS
        omega, start = math.sqrt((k + m * GRAVITY * l) / (m * l**2)), 1e-4
        swing = rne.simulate(scene, [start], [0], 3.0, rtol=1e-11, atol=1e-16, t_eval=np.linspace(0, 3, 50))
        # of the cubic term, start^2 / 16 of the phase omega t = 30 at most
        assert np.abs(swing.q[:, 0] - start * np.cos(omega * swing.t)).max() <= 2 * start**3

    def test_pendulum_with_a_line_spring(self):
        """From the wall at height h to the rod at distance r below the pivot: l^2 = h^2 + r^2 + 2 h r cos q."""
        k, rest, force, h, r = 400.0, 0.3, 25.0, 0.6, 0.4
        spring = rne.Spring("wall", [0, 0, h], "rod", [0, 0, -r], k, rest, force)
        scene = rne.Scene(pendulum(), gravity=[0, 0, 0], springs=[spring])
        q = np.linspace(-3, 3, 13)[:, None]
        l = np.sqrt(h**2 + r**2 + 2 * h * r * np.cos(q))
        torque = -(k * (l - rest) - force) * h * r * np.sin(q) / l
        assert relative(scene.inverse_dynamics(q, 0 * q, 0 * q), torque) <= 100 * EPS  # tensions are differences

    def test_a_zero_length_spring_balances_gravity(self):
        """With k h r = m g l, through the state in which its ends meet: h = r, the rod upright."""
        m, l, h = 2.0, 0.5, 0.4
        spring = rne.Spring("wall", [0, 0, h], "rod", [0, 0, -h], m * GRAVITY * l / h**2, 0)
        robot = pendulum(length=l, mass=m)
        scene = rne.Scene(robot, springs=[spring])
        q = np.concatenate([np.linspace(-math.pi, math.pi, 101), [math.pi]])[:, None]
        held = scene.inverse_dynamics(q, 0 * q, 0 * q)
        # k: rounded, and products of three numbers
        assert np.abs(held).max() <= 20 * EPS * np.abs(robot.gravity_torque(q)).max() <= 1e-12 * m * GRAVITY * l
        start = [2.0]
        motion = rne.simulate(scene, start, [1.5], 2.0, rtol=1e-12, atol=1e-14)  # passes through the point
        assert np.abs(motion.q[:, 0] - (2.0 + 1.5 * motion.t)).max() <= 1e-12

    def test_two_links_and_a_spring_between_them(self):
        """Of a free pair only the torque between them acts; the first joint feels none of it, not even rounding."""
        robot = rne.Robot(random_tree(2, seed=4, prismatic=0, branching=0))
        a, b = (robot.link_names[robot.model.link_body.index(i)] for i in (0, 1))
        spring = rne.Spring(a, [0.3, 0.1, 0.2], b, [-0.1, 0.4, 0.3], 500, 0.1, 20, 3)
        q, qd, _ = states(2, 20)
        extra = rne.Scene(robot, springs=[spring]).resolved.springs.torque(robot, q, qd)
        assert not extra[:, 0].any()
        assert np.abs(extra[:, 1]).min() > 0


class TestMotions:
    @pytest.mark.parametrize("smoothing", [0.01, 0.0])
    def test_energy_is_kept(self, arm, smoothing):
        """What springs store is potential energy, what their damping loses is in the ledger, under dry friction too."""
        friction = rne.Friction(viscous=1.0, coulomb=3.0, smoothing=smoothing)
        scene = rne.Scene(arm, springs=FEW, friction=friction)
        motion = rne.simulate(scene, [0.3] * 3, [0] * 3, 0.5, rtol=1e-8, atol=1e-10)
        assert motion.energy_drift <= 1e-5 * np.ptp(motion.potential)
        assert set(motion.dissipated) == {"viscous", "coulomb", "springs"}
        assert motion.dissipated["springs"][-1] > 1
        assert motion.potential[0] == pytest.approx(
            float(arm.potential_energy([0.3] * 3) + scene.resolved.springs.energy(arm, [0.3] * 3)), rel=1e-12
        )

    def test_springs_that_do_not_damp_are_conservative(self, arm):
        scene = rne.Scene(arm, springs=FEW[:2])
        assert scene.dynamics.ledger == ()
        motion = rne.simulate(scene, [0.3] * 3, [0] * 3, 0.5, rtol=1e-9, atol=1e-11)
        assert "nothing damps the motion" in motion.message
        assert motion.energy_drift <= 1e-7 * np.ptp(motion.potential)

    @pytest.mark.long
    def test_energy_of_a_long_swing(self, arm):
        motion = rne.simulate(rne.Scene(arm, springs=FEW[:2]), [0.3] * 3, [0] * 3, 20.0, rtol=1e-12, atol=1e-14)
        assert motion.energy_drift <= 1e-10 * np.ptp(motion.potential)

    def test_slopes_are_exact(self, arm):
        """The Jacobian of implicit methods against the complex step of the right-hand side."""
        sprung = rne.Scene(arm, springs=FEW)
        plant = Plant(sprung.dynamics, arm)
        q, qd, _ = states(3, 1)
        x = np.concatenate([q[0], qd[0], np.zeros(sprung.dynamics.size - 6)])
        core, columns = sprung.dynamics.right_hand_side_core, []
        for e in np.eye(len(x)):
            columns.append(core(arm.model, np.zeros((1, 1)), (x + 1e-30j * e)[None])[0][0].imag / 1e-30)
        condition = np.linalg.cond(arm.mass_matrix(q[0]))
        assert relative(plant.jacobian(0.0, x), np.stack(columns, -1)) <= 100 * EPS * condition

    def test_engines_agree(self, arm):
        pytest.importorskip("numba")
        q, qd, _ = states(2, 50)
        arm = arm.locked({"joint_3": 0.5})
        compiled, plain = (rne.Scene(rne.Robot(arm.model, e), springs=FEW[:3]) for e in ("numba", "numpy"))
        x = np.zeros((50, 1)), np.concatenate([q, qd], axis=1)
        assert relative(compiled.kernel(*x), plain.kernel(*x)) <= 1e-11

    @pytest.mark.long
    def test_implicit_methods_agree(self, arm):
        """In machine code and by SciPy, with slopes that are exact."""
        pytest.importorskip("numba")
        compiled, plain = (rne.Scene(rne.Robot(arm.model, e), springs=FEW) for e in ("numba", "numpy"))
        a = rne.simulate(compiled, [0.3] * 3, [0] * 3, 0.2, method="Rodas5P", rtol=1e-8, atol=1e-10)
        b = rne.simulate(plain, [0.3] * 3, [0] * 3, 0.2, method="Radau", rtol=1e-8, atol=1e-10)
        assert relative(a.q[-1], b.q[-1]) <= 1e-6

    def test_ensembles(self, arm):
        """Side by side as one by one; with parameters of their own, springs at joints that are locked left out."""
        q = states(3, 3)[0]
        scene = rne.Scene(arm, springs=FEW)
        motions = rne.ensemble(scene, q, 0 * q, 0.1, rtol=1e-9, atol=1e-11)
        one = rne.simulate(scene, q[2], 0 * q[2], 0.1, rtol=1e-9, atol=1e-11)
        assert motions.ledger == ("springs",)
        assert relative(motions.q[-1, 2], one.q[-1]) <= 1e-7
        assert motions.energies[-1, 2, 0] == pytest.approx(one.dissipated["springs"][-1], rel=1e-6)
        locked = rne.Scene(arm, springs=FEW, locked={"joint_3": 0.1}, stops=True)
        pi = locked.resolved.robot.parameters[None]
        few = [rne.ensemble(locked, 0.1 * q[:1, :2], 0 * q[:1, :2], 0.01, parameters=p) for p in (pi, None)]
        assert relative(few[0].q[-1], few[1].q[-1]) <= 1e-6

    def test_laws_may_ask_the_scene(self, arm):
        """Torques against springs in a traced law hold the arm."""
        held = rne.Scene(arm, springs=FEW)

        @rne.traceable
        def law(t, q, qd):
            return held.inverse_dynamics(q, 0 * qd, 0 * qd)

        scene = rne.Scene(arm, springs=FEW, controller=law)
        assert scene.cost()["law"] == "traced"
        motion = rne.simulate(scene, [0.2] * 3, [0] * 3, 0.2)
        assert np.abs(motion.q - 0.2).max() <= 1e-8

    def test_casadi(self, irb140, sprung):
        pytest.importorskip("casadi")
        q, qd, _ = states(6, 1)
        tau = np.ones(6)
        dx, _ = sprung.to_casadi()(0, np.concatenate([q[0], qd[0]]), tau)
        assert relative(np.array(dx)[6:, 0], sprung.forward_dynamics(q[0], qd[0], tau)) <= 1e-11

    def test_creep_is_told_of_what_springs_hold(self):
        """A balanced pendulum rests under smoothed friction: it does not creep."""
        spring = rne.Spring("wall", [0, 0, 0.4], "rod", [0, 0, -0.4], 2 * GRAVITY * 0.5 / 0.4**2, 0)
        friction = rne.Friction(coulomb=5.0)
        swings = [
            rne.simulate(rne.Scene(pendulum(), friction=friction, springs=s), [0.5], [0], 5.0) for s in ([], [spring])
        ]
        assert "crept" in swings[0].message
        assert "crept" not in swings[1].message
        pulled = rne.Scene(pendulum(), friction=friction, springs=[rne.Spring.at_joint("swing", 9.4, 0)])
        assert "crept" not in rne.simulate(pulled, [0.5], [0], 0.2).message  # it moves, as it should


class TestReports:
    def test_fastest_motion_keeps_the_limits(self, arm):
        pytest.importorskip("toppra")
        robot = arm.with_limits(effort=[250, 250, 150])
        springs = [FEW[0], *FEW[2:]]
        path = [[0] * 3, [1, 0.5, 0.3]]
        motion, alone = (rne.trajectories.fastest(robot, path, springs=s) for s in (springs, None))
        shares = motion.shares()["torque"]
        assert 0.98 <= shares.max() <= 1 + 2e-3
        assert abs(motion.duration / alone.duration - 1) > 0.01
        t = np.linspace(0, motion.duration, 9)
        assert relative(motion.torques(t), rne.Scene(robot, springs=springs).inverse_dynamics(*motion(t))) <= 1e-12
        assert rne.drives(robot, motion).torque_share.max() == pytest.approx(shares.max(), abs=2e-3)

    def test_damping_is_viscous_friction_to_the_fastest_motion(self, arm):
        pytest.importorskip("toppra")
        robot, path = arm.with_limits(effort=[250, 250, 150]), [[0] * 3, [1, 0.5, 0.3]]
        damped = rne.trajectories.fastest(robot, path, springs=[rne.Spring.at_joint("joint_1", 0, 0, damping=60)])
        alike = rne.trajectories.fastest(robot, path, friction=rne.Friction(viscous=[60, 0, 0]))
        assert damped.duration == pytest.approx(alike.duration, rel=1e-9)

    def test_bearings_carry_springs(self):
        """A pendulum at rest hangs on m g, and on a spring that pulls upwards along the rod besides."""
        spring = rne.Spring("wall", [0, 0, 1.0], "rod", [0, 0, -0.5], 10.0, 0.5)
        scene = rne.Scene(pendulum(), springs=[spring])
        rest = rne.trajectories.quintic([0.0], [0.0], 1.0)
        assert rne.bearing_peaks(scene, rest).force[0] == pytest.approx(2 * GRAVITY - 10.0, rel=1e-12)
        assert rne.drives(scene, rest).bearings.force[0] == pytest.approx(2 * GRAVITY - 10.0, rel=1e-12)

    def test_cost(self, irb140, sprung):
        """A spring between neighbours costs some 60 operations; without any nothing is added."""
        assert 30 < rne.Scene(irb140, springs=[GAS]).cost()["springs"] < 70
        assert "springs" not in rne.Scene(irb140).cost()
        assert rne.Scene(irb140, springs=[]).kernel.operations == rne.Scene(irb140).kernel.operations

    def test_energies_are_drawn_with_springs(self, sprung):
        from rne.plotting.motions import motion_argument

        motion = rne.simulate(sprung, [0.2] * 6, [0] * 6, 0.2)
        t, energies = motion_argument("motion", motion).curve("energy")
        assert np.array_equal(t, motion.t)
        assert np.array_equal(energies[:, 1], motion.potential)

    def test_viewer_shows_lines(self, irb140):
        pytest.importorskip("viser")
        pages = [rne.view(irb140, springs=s) for s in ([], MANY)]
        assert len(pages[1].html) > len(pages[0].html)
        with pytest.raises(ValueError, match=r"`springs\[0\].link` must be one of"):
            rne.view(irb140, springs=[rne.Spring("no", [0, 0, 0], "tool0", [0, 0, 0], 1, 1)])


class TestArguments:
    def test_equal_by_value(self):
        same = rne.Spring("a", np.zeros(3), "b", (0, 0, 1), 1, 2)
        other = rne.Spring("a", [0, 0, 0], "b", [0.0, 0.0, 1.0], 1.0, 2.0, 0, 0)
        assert same == other
        assert hash(same) == hash(other)
        assert pickle.loads(pickle.dumps(same)) == same
        assert same != rne.Spring("a", [0, 0, 0], "b", [0, 0, 1], 1, 2, 1)
        assert rne.Spring.at_joint("j", 1, 2) == rne.Spring.at_joint("j", 1.0, 2.0)

    def test_equal_scenes_share_kernels(self, irb140):
        a, b = (rne.Scene(irb140, springs=[rne.Spring(*vars(s).values()) for s in MANY[:3]]) for _ in range(2))
        assert a.kernel is b.kernel
        assert pickle.loads(pickle.dumps(a)).kernel.operations == a.kernel.operations

    @pytest.mark.parametrize(
        ("change", "text"),
        [
            ({"stiffness": -1}, "`stiffness` must not be negative, got -1.0"),
            ({"length": -0.1}, "`length` must not be negative, got -0.1"),
            ({"damping": np.nan}, "`damping` must be finite, got nan at index ()"),
            ({"force": np.inf}, "`force` must be finite, got inf at index ()"),
            ({"point": [0, 0]}, "`point` must have shape (3,), got (2,)"),
            ({"other_point": [0, 0, np.nan]}, "`other_point` must be finite, got nan at index (2,)"),
            ({"stiffness": "5"}, "`stiffness` must be one number, got str"),
        ],
    )
    def test_numbers(self, change, text):
        given = {"link": "a", "point": [0, 0, 0], "other": "b", "other_point": [0, 0, 0], "stiffness": 1, "length": 1}
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            rne.Spring(**(given | change))

    def test_nothing_but_places_is_no_spring(self):
        for length in ({}, {"length": 0.3}):
            with pytest.raises(ValueError, match=r"^one of `stiffness`, `force` and `damping` of the spring"):
                rne.Spring("a", [0, 0, 0], "b", [0, 0, 0], **length)
        assert rne.Spring("a", [0, 0, 0], "b", [0, 0, 0], force=-5) == rne.Spring("a", [0] * 3, "b", [0] * 3, 0, 0, -5)

    def test_a_stiffness_that_is_varied_may_be_zero(self, irb140):
        """At zero a spring does nothing: as of a sweep, of motions side by side, and where the scene is made."""
        ends, still = ("link_1", [0.3, -0.2, 0], "link_2", [0.2, 0.05, 0]), [0.0] * 6
        scene = rne.Scene(irb140, springs=[rne.Spring(*ends, 1000, 0.3)])
        absent = scene.with_numbers({"springs[0].stiffness": 0.0})
        assert absent.springs[0] == rne.Spring(*ends, 0, 0.3)
        np.testing.assert_allclose(
            absent.inverse_dynamics(still, still, still), irb140.gravity_torque(still), atol=1e-12
        )
        numbers = {"springs[0].stiffness": [0.0, 1000.0]}
        assert len(rne.ensemble(scene, [still] * 2, [still] * 2, 0.01, numbers=numbers).q) == 2

    def test_names(self, irb140):
        with pytest.raises(TypeError, match=r"^`link` must be a name, got int$"):
            rne.Spring(1, [0, 0, 0], "b", [0, 0, 0], 1, 1)
        cases = {
            r"`springs` must be a sequence of rne.Spring, got Spring": GAS,
            r"`springs\[0\]` must be an rne.Spring, got str": ["spring"],
            r"`springs\[1\].other` must be one of base_link, .*, got 'link2'; did you mean 'link_2'\?": [
                GAS,
                rne.Spring("link_1", [0, 0, 0], "link2", [0, 0, 1], 1, 1),
            ],
            r"`springs\[0\].joint` must be one of joint_1, .*, got 'link_1'": [rne.Spring.at_joint("link_1", 1, 0)],
            r"`springs\[0\]`: no joint moves between the ends of the spring between 'link_6' and 'tool0'": [
                rne.Spring("link_6", [0, 0, 0], "tool0", [0, 0, 1], 1, 1)
            ],
        }
        for text, springs in cases.items():
            with pytest.raises((TypeError, ValueError), match=f"^{text}"):
                rne.Scene(irb140, springs=springs)

    def test_tensions_that_overflow(self):
        scene = rne.Scene(pendulum(), springs=[rne.Spring.at_joint("swing", 1e200, 0.0)])
        with pytest.raises(
            rne.NotFiniteError, match=r"overflows? float64 for these arguments; the result is not finite$"
        ):
            scene.resolved.springs.torque(scene.robot, [1e200], [0.0])

    def test_ends_that_meet(self):
        """Named, in the state where they meet; a spring without length passes."""
        scene = rne.Scene(pendulum(), springs=[rne.Spring("wall", [0, 0, -0.4], "rod", [0, 0, -0.4], 100, 0.1)])
        text = (
            "the ends of the spring between 'wall' and 'rod' coincide, where its tension has no direction: only those of a "
            "spring without length, force and damping may"
        )
        with pytest.raises(rne.NotFiniteError, match=f"^{re.escape(text)} at state \\(1,\\)$"):
            scene.inverse_dynamics([[1.0], [0.0]], [[0.0]] * 2, [[0.0]] * 2)
        with pytest.raises(rne.SimulationError, match=re.escape(text)):
            rne.simulate(scene, [0.0], [0.0], 1.0)

    def test_locked_joints(self, irb140):
        """Springs that only locked joints would stretch do nothing; those over some of them act as before."""
        locked = {"joint_2": 0.3, "joint_5": 0.1}
        scene = rne.Scene(irb140, springs=MANY, locked=locked)
        assert scene.resolved.springs.each == (MANY[1], MANY[2])
        q, qd, _ = states(6, 10)
        whole = np.insert(np.insert(q[:, :4], 1, 0.3, 1), 4, 0.1, 1)
        rates = np.insert(np.insert(qd[:, :4], 1, 0, 1), 4, 0, 1)
        few = scene.resolved.springs.torque(scene.resolved.robot, q[:, :4], qd[:, :4])
        all_ = rne.Scene(irb140, springs=MANY[1:3]).resolved.springs.torque(irb140, whole, rates)
        assert relative(few, np.delete(all_, [1, 4], 1)) <= 100 * EPS


def multisine(n, duration, rate, seed):
    """Positions of joints that move at many frequencies, and their derivatives."""
    rng, t = np.random.default_rng(seed), np.arange(0, duration, 1 / rate)
    w = 2 * np.pi * np.arange(1, 11) / 10
    a, b = rng.normal(size=(2, n, 10)) / w
    phase = np.outer(t, w)
    q = np.sin(phase) @ a.T + np.cos(phase) @ b.T
    size = 1.2 / np.abs(q).max(0)
    qd = (np.cos(phase) * w) @ a.T - (np.sin(phase) * w) @ b.T
    qdd = -(np.sin(phase) * w**2) @ a.T - (np.cos(phase) * w**2) @ b.T
    return t, q * size, qd * size, qdd * size


def found_again(robot, seed):
    """A gas spring of a log with 2 % of noise: its estimate, and how far off it is in standard errors."""
    t, q, qd, qdd = multisine(robot.n, 20, 100, seed)
    true = rne.Spring("link_1", [-0.2, 0.0, 0.3], "link_2", [0.25, 0.12, 0.2], 12_000, 0.45)
    scene = rne.Scene(robot, springs=[true], friction=rne.Friction(viscous=5.0, coulomb=3.0, smoothing=0))
    tau = scene.inverse_dynamics(q, qd, qdd)
    tau += 0.02 * np.sqrt((tau**2).mean(0)) * np.random.default_rng(1000 + seed).normal(size=tau.shape)
    record = rne.identification.Record(t, q, tau)
    given = rne.Spring("link_1", [-0.2, 0.0, 0.3], "link_2", [0.25, 0.12, 0.2], 1, 1)
    found = rne.identify(robot, record, springs=[given], consistent=False, causes=False, drives=DRIVES, delay=0)
    (spring,), errors = found.springs, found.spring_errors[0]
    return found, record, np.abs([spring.stiffness - 12_000, spring.length - 0.45]) / errors


DRIVES = rne.DriveModel(friction="viscous+coulomb", offset=True)


class TestIdentification:
    def test_a_spring_is_found(self, arm):
        found, record, off = found_again(arm, 0)
        assert (off <= 3).all()
        k, c = found.estimate.values[-2:]
        moved = [[found.springs[0]._at(*x).length for x in ((k + s, c), (k, c + s))] for s in (1e-3, -1e-3)]
        slopes = np.array([[1, 0], np.subtract(*moved) / 2e-3])
        covariance = slopes @ found.estimate.covariance[-2:, -2:] @ slopes.T
        assert found.spring_errors[0] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-5)
        assert "spring between 'link_1' and 'link_2': stiffness " in found.report(details=True)
        (spring,) = found.springs
        q, qd, qdd = states(3, 5)
        assert relative(found.predict(q, qd, qdd), found.base.regressor(q, qd, qdd) @ found.values) <= 1e-12
        assert found.check(record).relative.max() < 0.05
        assert rne.Scene(arm, springs=found.springs).resolved.springs.each == (spring,)

    def test_numbers_become_springs(self):
        """Lengths that are not negative; preloads that pull have a force instead."""
        assert GAS._at(100.0, 350.0) == rne.Spring("link_1", GAS.point, "link_2", GAS.other_point, 100, 0.5, force=300)
        assert GAS._at(100.0, -50.0) == rne.Spring("link_1", GAS.point, "link_2", GAS.other_point, 100, 0, force=-50)
        assert MANY[1]._at(7.0).length == MANY[1]._at(7.0).force == 0

    @pytest.mark.long
    def test_within_three_standard_errors(self, irb140):
        """In 95 % of 100 logs."""
        off = np.array([found_again(irb140, seed)[2] for seed in range(100)])
        assert (off <= 3).mean(0).min() >= 0.95

    def test_springs_at_joints(self, arm):
        """The stiffness; a rest that is given wrongly comes out as an offset."""
        t, q, qd, qdd = multisine(3, 10, 100, 3)
        scene = rne.Scene(arm, springs=[rne.Spring.at_joint("joint_3", 300, 0.5)])
        record = rne.identification.Record(t, q, scene.inverse_dynamics(q, qd, qdd))
        given = rne.Spring.at_joint("joint_3", 1, 0.0)
        found = rne.identify(arm, record, springs=[given], consistent=False, drives=rne.DriveModel(offset=True))
        assert found.springs[0].stiffness == pytest.approx(300, rel=1e-2)
        assert found.offset[2] == pytest.approx(-150, rel=1e-2)

    def test_a_payload_beside_a_spring(self, arm):
        """A fit that knows the spring finds what is lifted."""
        logs = []
        for payload, seed in ((None, 3), (rne.Payload(5.0, [0, 0, 0.1]), 4)):
            t, q, qd, qdd = multisine(3, 10, 100, seed)
            scene = rne.Scene(arm, springs=[GAS], payload=payload)
            logs.append(rne.identification.Record(t, q, scene.inverse_dynamics(q, qd, qdd)))
        found = rne.identify(arm, logs[0], springs=[GAS], consistent=False, drives=rne.DriveModel())
        assert found.springs[0].length == pytest.approx(0.45, rel=1e-5)
        assert found.consistency().energy.missing <= 1e-3
        rest = FitResiduals(arm, found.base, found.data, found.estimate.values, found.estimate.sigma)
        assert relative(rest.load(q, qd, qdd), found.predict(q, qd, qdd)) <= 1e-9  # what gears transmit
        assert rne.identify_payload(found, None, logs[1]).payload.mass == pytest.approx(5, rel=5e-3)

    def test_a_preload_that_pulls(self, arm):
        """Beside possible bodies: c is negative, which no friction is."""
        pytest.importorskip("clarabel")
        t, q, qd, qdd = multisine(3, 10, 100, 6)
        true = rne.Spring("link_1", GAS.point, "link_2", GAS.other_point, 2000, 0, force=-900)
        record = rne.identification.Record(t, q, rne.Scene(arm, springs=[true]).inverse_dynamics(q, qd, qdd))
        given = rne.Spring("link_1", GAS.point, "link_2", GAS.other_point, 1, 1)
        (found,) = rne.identify(arm, record, springs=[given], drives=rne.DriveModel()).springs
        assert found.length == 0
        assert found.force == pytest.approx(-900, rel=0.05)

    def test_what_cannot_be_told(self):
        """A spring without length between the wall and a pendulum pulls as gravity does."""
        t, q, qd, qdd = multisine(1, 10, 200, 4)
        spring = rne.Spring("wall", [0, 0, 0.4], "rod", [0, 0, -0.4], 50, 0)
        scene = rne.Scene(pendulum(), springs=[spring])
        record = rne.identification.Record(t, q, scene.inverse_dynamics(q, qd, qdd))
        found = rne.identify(pendulum(), record, springs=[spring], consistent=False, drives=rne.DriveModel())
        text = "k_spring1 cannot be identified: it has no effect, or that of other parameters"
        with pytest.raises(rne.IdentificationError, match=f"^{text}$"):
            _ = found.springs
        assert f"springs: {text}" in found.report(details=True)
        text = "springs are not written out: use `predict`, or `scene` for the equations"
        with pytest.raises(rne.IdentificationError, match=f"^{text}$"):
            found.kernel()

    def test_a_spring_that_pushes_the_wrong_way(self):
        """Its torques are taken away instead of added."""
        t, q, qd, qdd = multisine(1, 10, 200, 4)
        spring, robot = rne.Spring.at_joint("swing", 50, 0.0), pendulum()
        without, sprung = (rne.Scene(robot, springs=x).inverse_dynamics(q, qd, qdd) for x in (None, [spring]))
        record = rne.identification.Record(t, q, 2 * without - sprung)
        options = {"consistent": False, "causes": False, "drives": rne.DriveModel()}
        with pytest.warns(rne.IdentificationWarning, match="^k_spring1 comes out negative, -50 .* which no spring has"):
            found = rne.identify(robot, record, springs=[spring], **options)
        text = r"the stiffness k_spring1 comes out negative, (.*): fit with `consistent=True`"
        with pytest.raises(rne.IdentificationError, match=f"^{text}$") as told:
            _ = found.springs
        assert float(re.fullmatch(text, str(told.value))[1]) == pytest.approx(-50, rel=1e-2)

    def test_damping_is_refused(self, irb140):
        t, q, _, _ = multisine(6, 2, 200, 5)
        with pytest.raises(ValueError, match=r"^`springs\[0\]` must have no damping, which is not found, got 40$"):
            rne.identify(irb140, rne.identification.Record(t, q, q), springs=[MANY[2]])
