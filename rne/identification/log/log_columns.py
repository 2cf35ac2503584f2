"""Which columns of a log are times, positions, velocities and torques of which joint, and in which units."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...basics.arrays import per_joint_array, positive_number
from ...basics.spatial import Array
from ...basics.text import MAX_NAME, cut, did_you_mean
from ...simulation.motion_files import numbered_joints
from ...trajectories.csv_file import Samples, guessed_unit, in_seconds, listed_names
from .log_files import LISTED, Log, read_log

WORDS = {
    "t": "t time timestamp stamp sec secs seconds",
    "q": "q pos position positions angle angles theta",
    "qd": "qd dq vel velocity velocities speed speeds omega",
    "tau": "tau torque torques effort efforts moment moments",
    "current": "current currents iq",
}
WORD = {word: kind for kind, words in WORDS.items() for word in words.split()}
ASKED = re.compile("target|desired|des|d|command|commanded|cmd|reference|ref|setpoint|goal|action|error|ext|external")
SPARE = re.compile("actual|measured|field|observation|state|feedback|log|data|j")  # which say nothing of the joint
TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|\d+")
BRACKETS = re.compile(r"\s*[\[(]\s*([^\])\d][^\])]*?)\s*[\])]\s*$")  # a unit at the end of a name
SUFFIX = re.compile(r"[_ .](deg|rad|ms|us|ns|rpm|mA|Nm)$")  # likewise
SI = {
    "q": {"rad": 1.0, "deg": np.pi / 180, "m": 1.0, "mm": 1e-3},
    "qd": {"rad/s": 1.0, "deg/s": np.pi / 180, "rpm": np.pi / 30, "m/s": 1.0, "mm/s": 1e-3},
    "tau": {"Nm": 1.0, "mNm": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3},
}
SINCE = 1e6  # [s], times beyond which count from the first one
ORDER = "else name the columns alike"
Columns = dict[str, dict[str, str]]  # names of columns by quantity and joint


def measured(path: Any, options: Mapping[str, Any]) -> tuple[dict[str, Any], list[str], list[tuple[str, str]]]:
    """The samples of a log, or of a file for each quantity, in units that are given, named in the log, or guessed.

    Returns t, q, tau, qd in SI units and the names of the joints, how the log was read, and guesses with their cures.
    """
    place = os.fspath(next(iter(path.values()), "`path`") if isinstance(path, Mapping) else path)
    log = _joined(path, options) if isinstance(path, Mapping) else read_log(Path(place), options)
    found = _by_joint(place, log, options["columns"] if isinstance(options["columns"], Mapping) else {})
    said, guesses = list(log.said), list[tuple[str, str]]()
    kinds, names = _same_joints(place, found, options["joints"], said, guesses)
    read = {kind: [log.numbers(place, name) for name in own] for kind, own in kinds.items()}
    rate, stamps = options["sample_rate"], list(found["t"].values())[:1]
    if rate is None and not stamps:
        there = listed_names(list(log.columns), LISTED)
        raise ValueError(f'{place}: there are no times; there are {there}; give columns={{"t": ...}} or `sample_rate`')
    timed = rate is None
    t = log.numbers(place, stamps[0]) if timed else np.arange(len(read["q"][0])) / positive_number("sample_rate", rate)
    if missing := np.flatnonzero(~np.isfinite(t)).tolist():
        raise ValueError(f"{place}: the time of sample {missing[0]} is missing")
    for kind, columns in read.items():
        if sizes := {len(column) for column in columns} - {len(t)}:
            raise ValueError(f"{place}: there are {len(t)} times and {min(sizes)} samples of {kind}")
    x = {kind: np.column_stack(columns) for kind, columns in read.items()}
    units = _units(place, kinds, options["units"])
    if log.is_lerobot and "q" not in options["units"]:
        cure = 'give units={"q": "deg"}, or rad per unit of each joint and `offsets`'
        raise ValueError(f"{place}: positions of LeRobot data sets are in degrees or normalised; {cure}")
    if units["q"] is None and np.median(np.nanmax(np.abs(x["q"]), axis=0, initial=0)) > 4 * np.pi:
        guesses.append(("positions are in degrees, as most pass two turns", 'else give units={"q": "rad"}'))
        units["q"] = "deg"
    gains, n = options["gains"], len(names)
    named = np.isin(np.asarray(units["tau"], dtype=object), ["A", "mA"]).any()
    if gains is None and (named or _meaning(kinds["tau"][0])[0] == "current"):
        cure = "give `gains` [N m/A]; gains=1 keeps currents, for `rne.identify_drive_gains`"
        raise ValueError(f"{place}: {_span(kinds['tau'])} are currents, not torques; {cure}")
    factors = per_joint_array("gains", 1 if gains is None else gains, n)
    if not factors.all():
        raise ValueError(f"`gains` must not be zero, got {gains!r}")
    units["qd"] = units["q"] if units["qd"] is None else units["qd"]
    q = x["q"] * _in_si("q", units["q"], n) + per_joint_array("offsets", options["offsets"], n)
    qd = x["qd"] * _in_si("qd", units["qd"], n) if "qd" in x else None
    tau = x["tau"] * _in_si("tau", units["tau"], n) * factors
    unit = options["time_unit"] or log.time_unit or (_meaning(stamps[0])[2] if timed else "s")
    if not unit and (seems := guessed_unit(t, q, qd)) is not None:
        guesses.append((f"column {stamps[0]!r} {seems.said}", 'else give time_unit="s"'))
        unit = seems.symbol
    t = in_seconds(place, Samples(t), unit or "s").t
    if t[0] > SINCE:
        said.append(f"times from the first sample on, at {t[0]:.3f} s")
        t = t - t[0]
    said += [f"{kind}: {_span(own)}" for kind, own in {"t": stamps[:timed], **kinds}.items() if own]
    return {"t": t, "q": q, "tau": tau, "qd": qd, "joint_names": names}, said, guesses


def _meaning(name: str) -> tuple[str, str, str]:
    """Quantity, joint and unit in names such as `q.<joint>`, `actual_current_3`, `joint1 pos [deg]`, `time_ms`."""
    unit = ""
    if bracket := BRACKETS.search(name):
        unit, name = bracket[1].replace(" ", "").replace("°", "deg"), name[: bracket.start()]
    own, _, joint = name.partition(".")
    if own in ("q", "qd", "tau") and joint:
        return own, joint, unit
    if not unit and (suffix := SUFFIX.search(name)):
        unit, name = suffix[1], name[: suffix.start()]
    tokens = list(TOKEN.finditer(name))
    words = [token[0].lower() for token in tokens]
    kinds = [WORD[word] for word in words if word in WORD] or ["q"] * ("state" in words)
    kept = [m for m, word in zip(tokens, words, strict=True) if word not in WORD and not SPARE.fullmatch(word)]
    joint = name[kept[0].start() : kept[-1].end()] if kept else ""
    if len(TOKEN.findall(joint)) != len(kept):
        joint = "_".join(m[0] for m in kept)
    kind = next((kind for kind in kinds if kind != "t"), "t")
    if not kinds or any(map(ASKED.fullmatch, words)) or (kind == "t" and joint):
        return "", "", ""
    return kind, joint, unit


def _joined(files: Mapping[str, Any], options: Mapping[str, Any]) -> Log:
    """The columns of a log of a file for each quantity, of which one has the times, or all the same."""
    columns, log = dict[str, Array](), Log({})
    times: dict[str, Array] = {}
    for kind, path in files.items():
        if kind not in ("t", "q", "qd", "tau"):
            raise ValueError(f'`path` must be a file, or files by "t", "q", "qd" and "tau", got {kind!r}')
        place, log = os.fspath(path), read_log(Path(path), {**options, "quantity": kind})
        for name in log.columns:
            what, joint, unit = _meaning(name)
            if "t" in (what, kind):
                columns.setdefault("t" + f" [{unit}]" * bool(unit), log.numbers(place, name))
                times[place] = log.numbers(place, name)
            elif what in ("", kind):
                columns[f"{kind}.{joint or name}" + f" [{unit}]" * bool(unit)] = log.numbers(place, name)
    for place, t in times.items():
        if not np.array_equal(t, next(iter(times.values()))):
            raise ValueError(f"{place}: its times are not those of {next(iter(times))}; interpolate by numpy.interp")
    return log._replace(columns=columns)


def _by_joint(place: str, log: Log, given: Mapping[str, Any]) -> Columns:
    """The columns of each quantity by joint: those given, of the others what their names say."""
    found: Columns = {kind: {} for kind in WORDS}
    if unknown := [kind for kind in given if kind not in ("t", "q", "qd", "tau")]:
        raise ValueError(f'`columns` must be of "t", "q", "qd" and "tau", got {unknown[0]!r}')
    for name in log.columns:
        kind, joint, _ = _meaning(name)
        if kind and kind not in given:
            if joint in found[kind]:
                both = f"{found[kind][joint]!r} and {name!r} are both {kind}{f' of {joint}' if joint else ''}"
                raise ValueError(f'{place}: columns {both}; say which in columns={{"{kind}": ...}}')
            found[kind][joint] = name
    for kind, wanted in given.items():
        parts = [wanted] if isinstance(wanted, str | int) else wanted
        own = [name for part in parts for name in _named(place, list(log.columns), part)]
        joints = [_meaning(name)[1] for name in own]
        found[kind] = dict(zip(joints if len(set(joints)) == len(own) else map(str, range(len(own))), own, strict=True))
    for kind, what in (("q", "positions"), ("tau", "torques or currents")):
        if not found[kind] and not (kind == "tau" and found["current"]):
            there = listed_names(list(log.columns), LISTED)
            cure = f'if some are, give columns={{"{kind}": ...}}'
            raise ValueError(f"{place}: there are no {what}; there are {there}; {cure}")
    return found


def _named(place: str, names: list[str], wanted: str | int) -> list[str]:
    """The columns of a name or number; of a matrix all."""
    own = [x for k, x in enumerate(names) if wanted in (x, k)] or [x for x in names if x.startswith(f"{wanted}.")]
    if not own:
        hint = did_you_mean(str(wanted), names) or f"; there are {listed_names(names, LISTED)}"
        raise ValueError(f"{place}: there is no column {wanted!r}, which `columns` asks for{hint}")
    return own


def _same_joints(
    place: str, found: Columns, joints: Sequence[str] | None, said: list[str], guesses: list[tuple[str, str]]
) -> tuple[dict[str, list[str]], tuple[str, ...]]:
    """Columns of each quantity for the same joints, and the names of these."""
    q, tau, qd = found["q"], found["tau"] or found["current"], found["qd"]
    if not q.keys() & tau.keys() and len(q) == len(tau):
        guesses.append((f"{_span([*tau.values()])} are of the joints of {_span([*q.values()])} in this order", ORDER))
        tau, qd = dict(zip(q, tau.values(), strict=True)), dict(zip(q, qd.values(), strict=False))
    common = [joint for joint in q if joint in tau]
    are_numbered = len({joint.rstrip("0123456789") for joint in common}) == 1  # and alike but for that
    if joints is not None and are_numbered and len(joints) == len(common) and not set(joints) & set(common):
        guesses.append((f"{_span([*q.values()])} are of {_span(joints)} in this order", ORDER))
    elif joints is not None:
        if missing := [joint for joint in joints if joint not in common]:
            hint = did_you_mean(missing[0], common) or f"; there are {listed_names(common, LISTED)}"
            raise ValueError(f"{place}: there are no positions and torques of joint {missing[0]!r}{hint}")
        common = list(joints)
    if not common:
        both = f"positions are {_span([*q.values()])}, torques {_span([*tau.values()])}"
        raise ValueError(f"{place}: no joint has positions and torques; {both}")
    if alone := [joint for joint in q if joint not in tau]:
        said.append(f"without torques, left out: {listed_names(alone)}")
    kinds = {"q": q, "tau": tau} | ({"qd": qd} if set(common) <= qd.keys() else {})
    names = joints or (numbered_joints(len(common)) if all(x.isdigit() or not x for x in common) else common)
    return {kind: [own[joint] for joint in common] for kind, own in kinds.items()}, tuple(names)


def _units(place: str, kinds: Mapping[str, Sequence[str]], given: Mapping[str, Any]) -> dict[str, Any]:
    """Units that are given, or that the names of all columns of a quantity have, or None; currents are in A or mA."""
    if not isinstance(given, Mapping) or set(given) - set(SI):
        raise ValueError(f'`units` must be a mapping of "q", "qd" and "tau", got {given!r}')
    units: dict[str, Any] = dict.fromkeys(SI) | dict(given)
    for kind in kinds.keys() - given.keys():
        meanings = [_meaning(name) for name in kinds[kind]]
        named = {unit or ("A" if what == "current" else None) for what, _, unit in meanings}
        if len(named) > 1:
            raise ValueError(
                f"{place}: columns {_span(kinds[kind])} name different units; give units={{{kind!r}: ...}}"
            )
        (units[kind],) = named
    return units


def _in_si(kind: str, unit: Any, n: int) -> Array:
    """A unit of all joints, or one of each, by name or as a number, in SI units; ones for None."""
    if unit is None:
        return np.ones(n)
    known = SI["q"] | SI["qd"] if kind == "qd" else SI[kind]
    units = [unit] * n if isinstance(unit, str | int | float) else list(unit)
    names = ", ".join(map(repr, SI[kind]))
    if len(units) != n or any(x.replace(" ", "") not in known if isinstance(x, str) else not x for x in units):
        raise ValueError(
            f"`units` of {kind} must be {names}, or a number of SI units, for all or {n} joints, got {unit!r}"
        )
    factors = [known[x.replace(" ", "")] if isinstance(x, str) else x for x in units]
    return per_joint_array(f"units of {kind}", factors, n)


def _span(names: Sequence[str]) -> str:
    """The first and the last name."""
    first, last = (repr(cut(names[k], MAX_NAME)) for k in (0, -1))
    return first if len(names) == 1 else f"{first} to {last}"
