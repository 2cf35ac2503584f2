"""Which columns of a log are times, positions, velocities and torques of which joint, and in which units."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...basics.text import MAX_NAME, cut, did_you_mean
from ...simulation.motion_files import numbered_joints
from ...trajectories.csv_file import FACTOR, UNITS, guessed_unit, listed_names, velocity_ratio
from .files import LISTED, Log, read_log

QUANTITIES = ("t", "q", "qd", "tau")
WORDS = {
    "t": "t time timestamp stamp sec secs seconds",
    "q": "q pos position positions angle angles theta",
    "qd": "qd dq vel velocity velocities speed speeds omega",
    "tau": "tau torque torques effort efforts moment moments",
    "current": "current currents iq",
}
WORD = {word: kind for kind, words in WORDS.items() for word in words.split()}
ASKED = set("target desired des d command commanded cmd reference ref setpoint goal action error ext external".split())
SPARE = set("actual measured field observation state feedback log data j".split())  # which say nothing of the joint
TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|\d+")
BRACKETS = re.compile(r"\s*[\[(]\s*([^\])\d][^\])]*?)\s*[\])]\s*$")  # a unit at the end
DEGREE, RPM, TURN = np.pi / 180, np.pi / 30, 2 * np.pi
SI = {
    "t": dict.fromkeys(UNITS, 1.0),
    "q": {"rad": 1.0, "deg": DEGREE, "m": 1.0, "mm": 1e-3},
    "qd": {"rad/s": 1.0, "deg/s": DEGREE, "rpm": RPM, "m/s": 1.0, "mm/s": 1e-3},
    "tau": {"Nm": 1.0, "N": 1.0, "mNm": 1e-3, "A": 1.0, "mA": 1e-3},
}
SI["current"] = SI["tau"]
SUFFIXES = {"deg", "rad", "ms", "us", "ns", "rpm", "mA", "Nm"}  # that are units at the end of a name
ORDER = "else name the columns alike"
NEAR = 2.0  # ratio of velocities that is told from those of other units
SINCE = 1e6  # [s], times beyond which count from the first one


class Meaning(NamedTuple):
    """What the name of a column says: quantity, joint and unit; empty where it says nothing."""

    kind: str
    joint: str
    unit: str


class Guess(NamedTuple):
    """What a log does not say, what it was taken for, and the cure where it is not so."""

    text: str
    cure: str


class Measured(NamedTuple):
    """Samples of a log in SI units, how it was read, and what was guessed."""

    t: Array
    q: Array
    tau: Array
    qd: Array | None
    joint_names: tuple[str, ...]
    said: list[str]
    guesses: list[Guess]


def meaning(name: str) -> Meaning:
    """What names such as `q.<joint>`, `actual_current_3`, `Position joint1 [deg]` or `time_ms` say."""
    unit, nothing = "", Meaning("", "", "")
    if bracket := BRACKETS.search(name):
        unit, name = bracket[1].replace(" ", "").replace("°", "deg"), name[: bracket.start()]
    own, _, joint = name.partition(".")
    if own in QUANTITIES and joint and not joint.isdigit():
        return Meaning(own, joint, unit)
    tokens = list(TOKEN.finditer(name))
    if len(tokens) > 1 and not unit and tokens[-1][0] in SUFFIXES:
        unit = tokens.pop()[0]
    words = [token[0].lower() for token in tokens]
    kinds = [WORD[word] for word in words if word in WORD] or ["q" for word in words if word == "state"]
    if not kinds or any(word in ASKED for word in words):
        return nothing
    kept = [token for token, word in zip(tokens, words, strict=True) if word not in WORD and word not in SPARE]
    joint = name[kept[0].start() : kept[-1].end()] if kept else ""
    if len(TOKEN.findall(joint)) != len(kept):
        joint = "_".join(token[0] for token in kept)
    kind = next((kind for kind in kinds if kind != "t"), "t")
    return nothing if kind == "t" and joint else Meaning(kind, joint, unit)


def measured(path: Any, options: Mapping[str, Any]) -> Measured:
    """The samples of a log, or of one file for each quantity, in units that are given, named in the log, or guessed."""
    place = os.fspath(next(iter(path.values()), "") if isinstance(path, Mapping) else path)
    log = joined(path, options) if isinstance(path, Mapping) else read_log(Path(place), options)
    found = by_joint(place, log, options["columns"] if isinstance(options["columns"], Mapping) else {})
    columns, names, said, guesses = same_joints(place, found, options["joints"])
    if options["sample_rate"] is None:
        columns["t"] = list(found["t"].values())[:1]
    x = {kind: np.column_stack([log.numbers(place, name) for name in own]) for kind, own in columns.items() if own}
    t = x.pop("t")[:, 0] if "t" in x else np.arange(len(x["q"])) / (options["sample_rate"] or np.nan)
    if np.isnan(t).all():
        there = listed_names(list(log.columns), LISTED)
        raise ValueError(f'{place}: there are no times; there are {there}; give columns={{"t": ...}} or `sample_rate`')
    if sizes := {len(array) for array in x.values()} - {len(t)}:
        raise ValueError(f"{place}: there are {len(t)} times, and {min(sizes)} samples in another column")
    units = units_of(columns, options["units"])
    if log.is_lerobot and "q" not in options["units"]:
        cure = 'give units={"q": "deg"}, or rad per unit of each joint, and `offsets` where they are'
        raise ValueError(
            f"{place}: positions of LeRobot data sets are in degrees or normalised, nothing says which; {cure}"
        )
    if "q" not in units and np.median(np.nanmax(np.abs(x["q"]), axis=0, initial=0)) > TURN:
        guesses.append(Guess("positions are in degrees, as most pass a turn", 'else give units={"q": "rad"}'))
        units["q"] = "deg"
    q = x["q"] * in_si("q", units.get("q", "rad"))
    qd = x["qd"] * in_si("qd", units.get("qd", units.get("q", "rad"))) if "qd" in x else None
    tau = (
        x["tau"]
        * in_si("tau", units.get("tau", "Nm"))
        * torque_per_unit(place, columns["tau"], units.get("tau"), options["gains"])
    )
    unit = options["time_unit"] or units.get("t") or log.time_unit or ("s" if "t" not in columns else None)
    if unit is None and (seems := guessed_unit(t, q, qd)) is not None:
        guesses.append(Guess(f"column {columns['t'][0]!r} {seems.said}", 'else give time_unit="s"'))
        unit = seems.symbol
    if unit not in (None, *UNITS):
        raise ValueError(f'`time_unit` must be "s", "ms", "us" or "ns", got {unit!r}')
    start = t[0] if t[0] / UNITS[unit or "s"] > SINCE else 0.0
    t = (t - start) / UNITS[unit or "s"]
    if start:
        said.append(f"times from the first sample on, at {start / UNITS[unit or 's']:.3f} s")
    if qd is not None and "qd" not in units and (ratio := abs(velocity_ratio(t, q, qd))) and not near_one(ratio):
        factor = in_si("q", units.get("q", "rad"))
        for other in ("rad/s", "deg/s", "rpm"):
            change = SI["qd"][other] / factor
            if near_one(float(np.mean(ratio * change))):
                guesses.append(Guess(f"velocities are in {other}, as positions change", 'else give units={"qd": ...}'))
                qd = qd * change
                break
    said = [*log.said, *(f"{kind}: {span(own)}" for kind, own in columns.items() if own), *said]
    return Measured(t, q + options["offsets"], tau, qd, names, said, guesses)


def joined(files: Mapping[str, Any], options: Mapping[str, Any]) -> Log:
    """The columns of a log of one file for each quantity, of which one has the times, or all have the same."""
    columns: dict[str, Array] = {}
    times: dict[str, Array] = {}
    for kind, path in files.items():
        if kind not in QUANTITIES:
            raise ValueError(f'`path` must be a file, or files by "t", "q", "qd" and "tau", got {kind!r}')
        log = read_log(Path(path), {**options, "quantity": kind})
        for name in log.columns:
            what = meaning(name)
            if "t" in (what.kind, kind):
                columns |= {} if times else {name if what.kind == "t" else "t": log.numbers(os.fspath(path), name)}
                times[os.fspath(path)] = log.numbers(os.fspath(path), name)
            elif what.kind in ("", kind):
                unit = f" [{what.unit}]" if what.unit else ""
                columns[f"{kind}.{what.joint or name}{unit}"] = log.numbers(os.fspath(path), name)
    for place, t in list(times.items())[1:]:
        if not np.array_equal(t, next(iter(times.values()))):
            raise ValueError(
                f"{place}: its times are not those of {next(iter(times))}; interpolate one by numpy.interp"
            )
    return log._replace(columns=columns)


def by_joint(place: str, log: Log, given: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """The columns of each quantity by joint: those given, of the others what their names say."""
    found: dict[str, dict[str, str]] = {kind: {} for kind in WORDS}
    if unknown := [kind for kind in given if kind not in QUANTITIES]:
        raise ValueError(f'`columns` must be of "t", "q", "qd" and "tau", got {unknown[0]!r}')
    for name in log.columns:
        kind, joint, _ = meaning(name)
        if kind and kind not in given:
            if joint in found[kind]:
                both = f"{found[kind][joint]!r} and {name!r} are both {kind}{f' of {joint}' if joint else ''}"
                raise ValueError(f'{place}: columns {both}; say which in columns={{"{kind}": ...}}')
            found[kind][joint] = name
    for kind, wanted in given.items():
        parts = [wanted] if isinstance(wanted, str | int) else list(wanted)
        own = [name for part in parts for name in _named(place, list(log.columns), part)]
        joints = [meaning(name).joint for name in own]
        found[kind] = dict(zip(joints if len(set(joints)) == len(own) else map(str, range(len(own))), own, strict=True))
    for kind, what in (("q", "positions"), ("tau", "torques or currents")):
        if not found[kind] and not (kind == "tau" and found["current"]):
            there = listed_names(list(log.columns), LISTED)
            raise ValueError(
                f'{place}: there are no {what}; there are {there}; if some are, give columns={{"{kind}": ...}}'
            )
    return found


def _named(place: str, names: list[str], wanted: str | int) -> list[str]:
    """The columns of a name or number; of a matrix all."""
    if isinstance(wanted, int) and 0 <= wanted < len(names):
        return [names[wanted]]
    own = [name for name in names if name == wanted] or [name for name in names if name.startswith(f"{wanted}.")]
    if not own:
        hint = did_you_mean(str(wanted), names) or f"; there are {listed_names(names, LISTED)}"
        raise ValueError(f"{place}: there is no column {wanted!r}, which `columns` asks for{hint}")
    return own


def same_joints(
    place: str, found: dict[str, dict[str, str]], joints: Sequence[str] | None
) -> tuple[dict[str, list[str]], tuple[str, ...], list[str], list[Guess]]:
    """Columns of each quantity for the same joints, the names of these, what was left out, and guesses."""
    q, tau, qd, said, guesses = found["q"], found["tau"] or found["current"], found["qd"], list[str](), list[Guess]()
    if not q.keys() & tau.keys() and len(q) == len(tau):
        guesses.append(
            Guess(f"{span(list(tau.values()))} are of the joints of {span(list(q.values()))}, in this order", ORDER)
        )
        tau = dict(zip(q, tau.values(), strict=True))
        qd = dict(zip(q, qd.values(), strict=True)) if len(qd) == len(q) and not qd.keys() & q.keys() else qd
    common = [joint for joint in q if joint in tau]
    numbered = len({joint.rstrip("0123456789") for joint in common}) == 1  # but for a number at the end they are alike
    if joints is not None and numbered and len(joints) == len(common) and not set(joints) & set(common):
        guesses.append(Guess(f"{span(list(q.values()))} are of {span(joints)}, in this order", ORDER))
    elif joints is not None:
        if missing := [joint for joint in joints if joint not in common]:
            hint = did_you_mean(missing[0], common) or f"; there are {listed_names(common, LISTED)}"
            raise ValueError(f"{place}: there are no positions and torques of joint {missing[0]!r}{hint}")
        common = list(joints)
    if not common:
        both = f"positions are {span(list(q.values()))}, torques {span(list(tau.values()))}"
        raise ValueError(f"{place}: no joint has positions and torques; {both}")
    if alone := [joint for joint in q if joint not in tau]:
        said.append(f"without torques, left out: {listed_names(alone)}")
    kinds = {"q": q, "tau": tau} | ({"qd": qd} if set(common) <= qd.keys() else {})
    names = joints or (numbered_joints(len(common)) if all(re.fullmatch(r"\d*", x) for x in common) else common)
    return {kind: [own[joint] for joint in common] for kind, own in kinds.items()}, tuple(names), said, guesses


def units_of(columns: Mapping[str, Sequence[str]], given: Mapping[str, Any]) -> dict[str, Any]:
    """Units that are given, or that the names of the columns have; currents are in A unless these say mA."""
    units: dict[str, Any] = {}
    for kind, own in columns.items():
        named = [meaning(name).unit or ("A" if meaning(name).kind == "current" else "") for name in own]
        if all(named):
            units[kind] = named[0] if len(set(named)) == 1 else named
        elif any(named):
            raise ValueError(f"some columns of {kind} name a unit, {own[named.index('')]!r} does not; give `units`")
    if unknown := [kind for kind in given if kind not in ("q", "qd", "tau")]:
        raise ValueError(f'`units` must be of "q", "qd" and "tau", got {unknown[0]!r}')
    return units | dict(given)


def in_si(kind: str, unit: Any) -> Array:
    """What a unit, or each of several, or a number of SI units, is in SI units."""
    known = SI["q"] | SI["qd"] if kind == "qd" else SI[kind]
    units = [unit] if isinstance(unit, str | int | float) else list(unit)
    try:
        factors = [known[x.replace(" ", "")] if isinstance(x, str) else float(x) for x in units]
    except (KeyError, TypeError, ValueError):
        factors = [0.0]
    if not np.all(factors) or not np.isfinite(factors).all():
        expected = ", ".join(map(repr, SI[kind]))
        raise ValueError(f"the unit of {kind} must be one of {expected}, or a number of SI units, got {unit!r}")
    return np.array(factors)


def span(names: Sequence[str]) -> str:
    """The first and the last name."""
    first, *_, last = [repr(cut(name, MAX_NAME)) for name in (names[0], *names)]
    return first if len(names) == 1 else f"{first} to {last}"


def near_one(ratio: float) -> bool:
    """True for a ratio that noise explains."""
    return 1 / NEAR < ratio < NEAR


def torque_per_unit(place: str, own: Sequence[str], unit: Any, gains: Any) -> Any:
    """One for torques, for currents the torque of each joint per ampere."""
    units = [unit] if isinstance(unit, str) or unit is None else list(unit)
    if gains is None and any(x in ("A", "mA") for x in units):
        raise ValueError(
            f"{place}: {span(own)} are currents: give `gains`, the torque of each joint per ampere [N m/A]; gains=1 keeps "
            "currents, for `rne.identify_drive_gains`"
        )
    return 1.0 if gains is None else gains
