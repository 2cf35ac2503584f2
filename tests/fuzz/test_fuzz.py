"""Random scenes, every part of a scene with every other, against an integration that shares no code with rne's.

Thousands of them: python -m tests.fuzz COUNT [START [ENGINE]].
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ..helpers import kept
from . import comparison, oracle
from .case import Case, Joint
from .comparison import check, difference, simulated
from .oracle import motion
from .scenes import draw

SHORT, LONG = range(1, 3), range(1000, 1100)
CHAOTIC = 0.15  # of the seeds: more would say that the draws are too wild to be a test
CLOSED_FORM = 1e-9  # of the oracle at tolerance 1e-11


def run(seeds, **options):
    outcomes = {seed: check(seed, **options) for seed in seeds}
    failed = [f"# seed {seed}: {o.words}\n{o.script}" for seed, o in outcomes.items() if o.kind == "failed"]
    kinds = [o.kind for o in outcomes.values()]
    assert not failed, "\n".join([f"{len(failed)} of {len(kinds)}", *failed])
    assert kinds.count("chaotic") <= CHAOTIC * len(kinds)
    assert kinds.count("refused") <= CHAOTIC * len(kinds)
    assert kinds.count("compared") > len(kinds) / 2


@pytest.mark.parametrize("seeds", kept([SHORT, range(8)], [SHORT]), ids=len)
def test_random_scenes(seeds):
    run(seeds, small=True)


@pytest.mark.long
def test_many_random_scenes():
    run(LONG)


@pytest.mark.parametrize("seed", kept(range(6), range(2)))
def test_a_script_runs_alone_and_is_the_case(seed):
    case = draw(seed, small=True)
    names = {}
    exec(case.script(), names)
    assert np.array_equal(names["motion"].q, simulated(case.script())[0].q)
    assert names["robot"].model.nb == len(case.joints)
    assert names["motion"].q[0].tolist() == case.q0


def test_a_seed_is_a_case():
    assert draw(5).script() == draw(5).script() != draw(6).script()


def test_every_part_is_drawn():
    cases = [draw(seed) for seed in range(400)]
    parts = ("scene_gravity", "mounting", "payload", "locked", "armature", "friction", "effort_limit", "torque_rate")
    for part in (*parts, "stops", "law", "sample_time"):
        assert 10 < sum(bool(getattr(case, part)) for case in cases) < 390, part
    assert {case.method for case in cases} == {"auto", "DOP853", "RK45", "LSODA", "Radau", "BDF"}
    assert len({case.law["kind"] for case in cases if case.law}) == 11
    assert sum(case.sticks and case.sample_time is not None for case in cases) > 20
    assert sum(any(joint.mimic for joint in case.joints) for case in cases) > 20


@pytest.mark.long
def test_what_is_drawn_happens():
    """Stops end runs, joints stick and slip."""
    integrations = [oracle.Integration(draw(seed, small=True), comparison.COARSE) for seed in range(20)]
    motions = [integration.run() for integration in integrations]
    assert sum(end.status for end in motions) >= 1
    assert sum(integration.changes > 0 for integration in integrations) >= 2


def test_differences_are_seen():
    """A motion that differs a little in one of the things compared."""
    case = next(case for case in map(draw, range(100)) if case.friction and case.law and case.sample_time is None)
    exact = motion(case, 1e-9)
    good = dict(t=exact.t, q=exact.q, qd=exact.qd, work=exact.energies[:, 0], status=exact.status, message="")
    good |= {"controller_state": exact.z}
    good["dissipated"] = {"viscous": exact.energies[:, 1], "coulomb": exact.energies[:, 2]}
    assert difference(SimpleNamespace(**good), exact) == []
    for name in ("q", "qd", "work"):
        worse = good | {name: good[name] * (1 + 1e-3)}
        assert difference(SimpleNamespace(**worse), exact)[0].startswith(f"{name} is ")
    assert "status" in difference(SimpleNamespace(**good | {"status": -1}), exact)[0]
    assert "ends at" in difference(SimpleNamespace(**good | {"t": good["t"] * 1.001}), exact)[0]


class TestOracle:
    """The oracle against closed forms: a block of 1 kg on a horizontal slide."""

    block = Case(
        seed=0,
        joints=[Joint("prismatic", -1, [0.0] * 3, [0.0] * 3, [1.0, 0, 0], 1.0, [0.0] * 3, (0.1 * np.eye(3)).tolist())],
        gravity=[0.0] * 3,
        q0=[0.0],
        qd0=[1.0],
        duration=2.0,
    )

    def end(self, **parts):
        return motion(replace(self.block, **parts), comparison.FINE)

    def test_a_block_comes_to_rest(self):
        end = self.end(friction={"coulomb": [1.0], "smoothing": 0})
        assert end.q[-1, 0] == pytest.approx(0.5, abs=CLOSED_FORM)
        assert end.energies[-1].tolist() == pytest.approx([0, 0, 0.5], abs=CLOSED_FORM)

    def test_a_block_breaks_away_at_static_friction(self):
        """Force 2 t under static friction 2: it moves from t = 1 on, by the integral of (t² - 1 - (t - 1))."""
        law = {"kind": "switch", "before": [0.0], "after": [2.5], "time": 1.0}
        end = self.end(qd0=[0.0], friction={"coulomb": [1.0], "static": [2.0], "smoothing": 0}, law=law)
        assert end.q[-1, 0] == pytest.approx(0.75, abs=CLOSED_FORM)
        law["after"] = [1.9]
        end = self.end(qd0=[0.0], friction={"coulomb": [1.0], "static": [2.0], "smoothing": 0}, law=law)
        assert end.q[-1, 0] == 0

    def test_a_held_joint_stays_while_another_turns_back(self):
        """A block slides on another, which its friction of either sign leaves at rest, but nothing would with both at rest.

        The load of the lower one is -3 + 3 + 1 and -3 + 3 - 1 while the upper one slides, and -3 if that were at rest.
        """
        joints = [self.block.joints[0], replace(self.block.joints[0], parent=0)]
        friction = {"coulomb": [0.5, 1.0], "static": [2.0, 1.0], "smoothing": 0}
        law = {"kind": "constant", "u": [-3.0, -3.0]}
        end = self.end(joints=joints, q0=[0.0, 0.0], qd0=[0.0, 1.0], duration=1.0, friction=friction, law=law)
        assert end.q[-1].tolist() == pytest.approx([0, 1 / 8 - 0.75**2], abs=CLOSED_FORM)

    def test_a_block_meets_its_stop(self):
        joint = replace(self.block.joints[0], upper=0.25)
        end = self.end(joints=[joint], stops=True, law={"kind": "constant", "u": [-1.0]}, effort_limit=[1.0])
        assert (end.status, end.joint) == (1, 0)
        assert end.end == pytest.approx(1 - np.sqrt(0.5), abs=CLOSED_FORM)

    def test_torques_are_held_and_change_by_their_rate(self):
        """Torques 1, then falling by 0.5 per sample to -1: rates by the sum of torques times 0.25 s."""
        law = {"kind": "switch", "before": [1.0], "after": [-1.0], "time": 0.1}
        end = self.end(law=law, sample_time=0.25, torque_rate=[2.0], duration=1.5)
        assert end.qd[-1, 0] == pytest.approx(1 + 0.25 * (1 + 0.5 + 0 - 0.5 - 1 - 1), abs=CLOSED_FORM)

    def test_a_loop_that_diverges_is_ill_posed(self):
        law = {"kind": "pd", "kp": [-1e4], "kd": [0.0], "ref": [0.0]}
        with pytest.raises(oracle.IllPosed, match="diverges"):
            self.end(law=law)
