"""Records with commanded positions: what they keep, what is said of their commands, and who needs torques."""

import pickle
import re

import numpy as np
import pytest

import rne
from rne.identification import Record

from .helpers import first_joints

RATE = 100
T = np.arange(400) / RATE
COMMAND = np.column_stack([np.sin(2 * T) - 0.3, 0.8 * np.cos(3 * T)])
Q = COMMAND - 0.02 * np.column_stack([np.cos(2 * T), -np.sin(3 * T)])  # which follow by some ten milliseconds


def said(command=COMMAND, q=Q, t=T, **options):
    """Findings of a record with these commands, as joint, kind and samples."""
    record = Record(t, q, command=command, **options)
    return [(x.joint, x.kind, x.samples) for x in record.findings]


def test_a_record_keeps_its_commands_in_si_units_and_has_no_torques():
    record = Record(T, np.rad2deg(Q), command=np.rad2deg(COMMAND), command_rate=np.rad2deg(Q), unit="deg")
    for found, given in ((record.q, Q), (record.command, COMMAND), (record.command_rate, Q)):
        np.testing.assert_allclose(found, given, rtol=1e-14)  # of degrees and back, by rounding
    assert record.tau is None
    assert record.command_hold
    assert not record.findings
    assert repr(record) == "Record 'record': 400 samples of 2 joints, 3.99 s, commands without torques, 0 findings"


def test_parts_and_copies_have_their_commands():
    whole = Record(T, Q, command=COMMAND, command_rate=2 * COMMAND, command_hold=False)
    part, again = whole.between(1, 2), pickle.loads(pickle.dumps(whole))
    assert np.array_equal(part.command, COMMAND[100:201])
    assert np.array_equal(part.command_rate, 2 * COMMAND[100:201])
    assert np.array_equal(again.command, COMMAND)
    assert again.tau is None
    assert not (part.command_hold)
    assert not (again.command_hold)
    assert not (whole.in_motion().command_hold)


def test_torques_are_what_they_are_without_commands_beside_them():
    tau = np.cos(5 * Q)
    both, alone = Record(T, Q, tau, command=COMMAND), Record(T, Q, tau)
    assert np.array_equal(both.prepare().tau, alone.prepare().tau)
    assert not both.findings
    assert np.array_equal(both.cleaned.command, COMMAND)
    assert alone.cleaned.command is None


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({}, "`tau` or `command` must be given, got neither"),
        ({"tau": Q, "command_rate": Q}, "`command_rate` must come with the positions, `command`"),
        ({"command": COMMAND.T}, "`command` must have shape (400, 2), got (2, 400)"),
        ({"command": COMMAND, "command_rate": Q[1:]}, "`command_rate` must have shape (400, 2), got (399, 2)"),
    ],
)
def test_wrong_arguments_are_named(arguments, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        Record(T, Q, **arguments)


@pytest.mark.parametrize(
    "call",
    [
        lambda arm, record: record.prepare(),
        lambda arm, record: rne.identify(arm, record),
        lambda arm, record: rne.identify_payload(arm, record, record),
        lambda arm, record: rne.identification.regression(arm, record, arm.base_parameters()),
    ],
)
def test_who_needs_torques_says_what_fits_a_model_without(call):
    text = "servo: the record has commands and no torques: rne.identify_motion fits a model from these"
    with pytest.raises(ValueError, match=f"^{text}$"):
        call(first_joints(2), Record(T, Q, command=COMMAND, name="servo"))
