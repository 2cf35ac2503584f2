"""The IRB 140 of the thesis: its numbers, its URDF, what it claims."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import rne
from rne.control import pd_gravity
from rne.model import cylinder_inertia
from rne.model.abb_irb140 import CLOSED_LOOPS, LINKS, frame_rotation
from rne.model.topology import tip
from rne.plotting.shapes import link_shapes

from .helpers import KD, KP, ROOT, states

URDF = ROOT / "robots" / "irb140.urdf"


def test_urdf_is_what_the_writer_makes():
    assert URDF.read_text(encoding="utf-8") == rne.to_urdf(rne.irb140())


def test_urdf_loads_as_the_same_model():
    file, built = rne.read_urdf(URDF), rne.irb140()
    assert file == built
    assert file.link_parent == built.link_parent
    assert tip(file).tolist() == tip(built).tolist() == [0, 0, 0.065]  # r_{5,6} (4.24)
    assert "their widths are ASSUMED" in built.notes["robot"]
    for link, end in zip(
        ("link_2", "link_4", "link_6"), (0.36, 0.38, 0.065), strict=True
    ):  # shapes reach the next joint
        points = np.concatenate([x.faces().reshape(-1, 3) for x in link_shapes(built) if x.link == link])
        assert points.max() == pytest.approx(end, abs=0.09)


def test_flange_is_the_thesis_frame_6(irb140):
    """Products of the thesis's own rotations and lengths: R_6^0, and the sum of the turned r_{i-1,i}."""
    q, _, _ = states(6, seed=1)
    R, p = np.eye(3), np.zeros(3)
    for link, x in zip(LINKS, q, strict=True):
        R = R @ frame_rotation(link, x)
        p = p + R @ link.r_end
    np.testing.assert_allclose(irb140.link_poses(q)[-1], np.block([[R, p[:, None]], [0, 0, 0, 1]]), atol=4e-16)


def test_ends_of_all_six_links_are_on_record_from_file_and_builder():
    s = states(6, 3)
    file, built = (rne.dynamics.recursion(model, *s).a_e for model in (rne.read_urdf(URDF), rne.irb140()))
    assert built.shape == (3, 6, 3)
    assert np.array_equal(file, built)


@pytest.mark.parametrize("source", ["irb140", URDF])
def test_a_payload_sits_at_the_flange(source):
    """The arm stretched out as in (6.21): the lever about joint 2 is 0.360 + 0.380 + 0.065 = 0.805 m."""
    arm = rne.load(source)
    q = [0, math.pi / 2, -math.pi / 2, 0, 0, 0]
    for loaded in (arm.with_payload(6.0), rne.Scene(arm, payload=6.0), rne.Scene(arm, payload=rne.Payload(6.0))):
        added = loaded.inverse_dynamics(q, np.zeros(6), np.zeros(6)) - arm.gravity_torque(q)
        np.testing.assert_allclose(added[1:3], -6 * 9.81 * np.array([0.805, 0.380 + 0.065]), rtol=1e-13)


def test_the_flange_costs_nothing_and_changes_no_torque(irb140, tmp_path):
    """The arm without the frame, from the same file, has bit by bit the same parameters of its bodies."""
    text = URDF.read_text(encoding="utf-8")
    bodies = ("axis", "rotation", "translation", "mass", "com", "inertia")
    without = re.sub(r'  <link name="tool0"/>.*?</joint>\n', "", text, flags=re.DOTALL)
    assert without.count("<link") == 7
    path = tmp_path / "bare.urdf"
    path.write_text(without, encoding="utf-8")
    bare = rne.read_urdf(path)
    assert all(np.array_equal(getattr(bare, name), getattr(irb140.model, name)) for name in bodies)
    counts = [
        sum(irb140.kernel(f).operations.values())
        for f in (rne.dynamics.inverse_dynamics, rne.dynamics.mass_matrix, rne.dynamics.forward_dynamics)
    ]
    assert counts == [280, 155, 538]


def test_urdf_has_no_findings(capsys):
    assert rne.check(URDF) == []
    assert capsys.readouterr().out.endswith("irb140.urdf: no findings\n")


def test_load_by_name_reads_no_file(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "irb140").write_text("not a robot")
    monkeypatch.setattr(Path, "open", lambda *a, **k: pytest.fail("a file was opened"))
    assert rne.load("irb140").model == rne.irb140()


def test_joints_and_links_have_their_names(irb140):
    assert irb140.joint_names == tuple(f"joint_{i}" for i in range(1, 7))
    assert irb140.link_names == ("base_link", *(f"link_{i}" for i in range(1, 7)), "tool0")
    assert irb140.n == 6


def test_densities_of_the_cylinders_are_about_the_thesis_1500():
    """Mass by volume of table 4.1's cylinders; the thesis states 1500 kg/m^3."""
    solid = [link for link in LINKS if link.mass]
    densities = [link.mass / (math.pi * link.radius**2 * link.height) for link in solid]
    np.testing.assert_allclose(densities, [1506.5, 1493.5, 1501.0, 1516.1], rtol=0, atol=0.05)


def test_reach_of_axis_5_is_that_of_the_data_sheet(irb140):
    """0.070 + 0.360 + 0.380 = 0.810 m from axis 1 with the arm stretched out, and nowhere more."""
    wrist = irb140.model.link_index("link_5")
    stretched = irb140.link_poses([0, math.pi / 2, -math.pi / 2, 0, 0, 0])[wrist, :2, 3]
    assert np.hypot(*stretched) == pytest.approx(0.810, rel=1e-15)
    anywhere = irb140.link_poses(states(6, 2000)[0])[:, wrist, :2, 3]
    assert np.hypot(*anywhere.T).max() <= 0.810


def test_axes_are_the_thesis_b_i(irb140):
    assert irb140.model.axis.tolist() == [[0, -1, 0], [0, 0, 1], [0, -1, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1]]


def test_holding_torque_is_that_of_6_21(irb140):
    q = [0, math.pi / 2, -math.pi / 2, 0, 0, 0]
    expected = np.array([0, -16.191, -2.409, 0, -0.029, 0]) * 9.81
    np.testing.assert_allclose(irb140.gravity_torque(q), expected, atol=1e-13)


def test_potential_energy_at_zero_is_that_of_6_4(irb140):
    assert irb140.potential_energy(np.zeros(6)) == pytest.approx(370.87686, abs=1e-12)


def test_potential_energy_is_the_sum_of_heights(irb140):
    """(6.32) with (6.33)-(6.38), the last with the cos q4 that the thesis leaves out."""
    q, _, _ = states(6, 100)
    _s2, c2, s23, c23 = np.sin(q[:, 1]), np.cos(q[:, 1]), np.sin(q[:, 1] + q[:, 2]), np.cos(q[:, 1] + q[:, 2])
    h1 = 0.264
    h2 = 0.352 + 0.201 * c2
    h4 = 0.352 + 0.360 * c2 - 0.080 * s23
    h6 = 0.352 + 0.360 * c2 - 0.380 * s23 + 0.029 * (-s23 * np.cos(q[:, 4]) - c23 * np.cos(q[:, 3]) * np.sin(q[:, 4]))
    expected = 9.81 * (27 * h1 + 22 * h2 + 25 * h4 + 1 * h6)
    np.testing.assert_allclose(irb140.potential_energy(q), expected, atol=1e-12)


def test_record_follows_the_thesis_recursion(irb140):
    """(3.29)-(3.38) and (3.24)-(3.27), written out with the thesis's own rotations and lengths."""
    q, qd, qdd = states(6, seed=3)
    record = irb140.recursion(q, qd, qdd)
    R = [frame_rotation(link, x) for link, x in zip(LINKS, q, strict=True)]
    w = a = ae = np.zeros(3)
    R0 = np.eye(3)
    forces = []
    for i, link in enumerate(LINKS):
        R0 = R0 @ R[i]
        b = R[i].T @ [0, 0, 1]
        w = R[i].T @ w + b * qd[i]
        a = R[i].T @ a + b * qdd[i] + np.cross(w, b * qd[i])
        start = R[i].T @ ae
        ac = start + np.cross(a, link.r_com) + np.cross(w, np.cross(w, link.r_com))
        ae = start + np.cross(a, link.r_end) + np.cross(w, np.cross(w, link.r_end))
        g = R0.T @ [0, 0, -9.81]
        for name, value in {"omega": w, "alpha": a, "a_c": ac, "a_e": ae, "gravity": g}.items():
            np.testing.assert_allclose(getattr(record, name)[i], value, atol=1e-11, err_msg=f"{name} {i + 1}")
        forces.append((w, a, link.mass * (ac - g)))
    f = t = np.zeros(3)
    below = np.eye(3)
    for i in reversed(range(6)):
        link, (w, a, net) = LINKS[i], forces[i]
        I = cylinder_inertia(link.mass, link.radius, link.height, link.along)
        f_next, t_next = below @ f, below @ t
        f = f_next + net
        arm = np.subtract(link.r_com, link.r_end)
        t = t_next - np.cross(f, link.r_com) + np.cross(f_next, arm) + np.cross(w, I @ w) + I @ a
        np.testing.assert_allclose(record.f[i], f, atol=1e-10)
        np.testing.assert_allclose(record.tau[i], t, atol=1e-10)
        np.testing.assert_allclose(record.u[i], t @ (R[i].T @ [0, 0, 1]), atol=1e-10)
        below = R[i]


def test_bearing_of_joint_1_carries_the_arms_weight(irb140):
    still = np.zeros(6)
    force, torque = rne.dynamics.bearing_loads(irb140.recursion(still, still, still), irb140.model)
    assert force[0] == pytest.approx(75 * 9.81, rel=1e-14)
    assert torque.shape == (6,)


def test_closed_loop_6_5_1_settles(irb140):
    scene = CLOSED_LOOPS[0]
    law = pd_gravity(irb140, KP, KD, scene.reference)
    t = np.linspace(0, 5, 1001)
    motion = rne.simulate(irb140, scene.start, np.zeros(6), 5.0, torque=law, t_eval=t)
    assert motion.method == "LSODA"
    outside = np.abs(motion.q - np.array(scene.reference)).max(axis=1) > 0.01
    assert motion.t[np.flatnonzero(outside)[-1] + 1] == pytest.approx(2.81, abs=0.03)
    assert motion.evaluations <= 2500


def test_hanging_arm_stays(irb140):
    q = np.array([0, math.pi, -math.pi / 2, 0, 0, 0])
    motion = rne.simulate(irb140, q, np.zeros(6), 2.0)
    assert np.abs(motion.q - q).max() <= 1e-8


def test_numbers_of_the_controlled_runs_are_those_of_section_6_5():
    """A second transcription, in degrees."""
    runs = [
        ((0, 0, 0, 0, 0, 0), (90, 0, -90, 180, 90, -180)),
        ((0, 180, -90, 0, 0, 0), (180, 0, 0, 180, -90, 0)),
        ((0, 90, -90, 0, 0, 0), (-180, 180, -180, -180, -90, 180)),
    ]
    for run, (start, reference) in zip(CLOSED_LOOPS, runs, strict=True):
        np.testing.assert_allclose(np.degrees(run.start), start, rtol=1e-15)
        np.testing.assert_allclose(np.degrees(run.reference), reference, rtol=1e-15)
        assert run.duration == 5
    assert (KP, KD) == ((50, 50, 50, 50, 50, 60), (20, 20, 20, 20, 20, 22))
