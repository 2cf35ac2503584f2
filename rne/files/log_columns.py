"""Columns of a log: times, positions, velocities and torques, their joints and units."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..basics.arrays import per_joint_array, positive_number
from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut, did_you_mean
from .logs import LISTED, UNIT, Log, LogOptions, read_log, symbol, with_stamps
from .samples import Samples, in_seconds, logged
from .tables import listed_names
from .time_units import guessed_unit

WORDS = {
    "t": "t ts tout time timestamp stamp sec secs seconds zeit",
    "q": "pos qpos position positions angle angles winkel",
    "qd": "qd dq qdot dtheta thetadot vel qvel velocity velocities speed speeds omega ω geschwindigkeit",
    "": "qdd ddq ddtheta qddot ddot acc accel acceleration accelerations",  # not read
    "tau": "tau τ torque torques trq tor eff effort efforts moment moments drehmoment",
    "force": "force forces",
    "current": "current currents curr iq strom",
}
TORQUES = {"tau": "tau", "current": "tau", "force": "tau"}  # kinds that stand for torques
BY_UNIT = {"Nm": "tau", "mNm": "tau", "N": "force", "A": "current", "mA": "current"}  # whatever the word
WORD = {word: kind for kind, words in WORDS.items() for word in words.split()}
BETWEEN = ("", *"/.[]()")  # around a joint's name that is a part of its own
SYMBOLS = ("q", "theta", "θ")  # positions where no other word names a quantity, as in "theta1" beside "theta1_effort"
KINDS = {*WORD, *SYMBOLS, "dot"}
ASKED = re.compile(  # words of commands and limits; in the second group those of joints' names too, such as a slide d3
    "(?:target|desired|command|commanded|cmd|reference|set|setpoint|goal|action|soll|planned|limit|min|max)s?"
    "|(d|des|ref|errors?|ext|external)"
)
COMMANDED = re.compile(  # of these words those of commands; in the second group where a word names the quantity
    "(?:target|desired|command|commanded|cmd|reference|set|setpoint|goal|action|soll|planned)s?|(d|des|ref)"
)
SPARE = re.compile(  # words that say nothing of the joint
    "actual|act|measured|meas|est|estimated|present|ist|angular|field|observation|state|feedback|fbk|log|data|values?|j"
)
CLOCKS = re.compile(  # words in addition to "time" and "stamp"
    "header|elapsed|rel|relative|since|start|system|epoch|unix|ros|rosbag|robot|sim|recv|s"
)
TOKEN = re.compile(r"d+(?:Q|Theta)(?![^\W\d_])|[A-Z]+(?![^\W\d_A-Z])|[A-Z]?[^\W\d_A-Z]+|\d+")
TOPIC = re.compile(r"(?:dynamic_?)?joint_?states?|[/.]", re.IGNORECASE)  # ends the name of a topic or structure
BRACKETS = re.compile(r"\s*[\[(]\s*((?=[^\])]*[^\W\d_]|[%°])[^\])]+?)\s*[\])]\s*$")  # a unit at the end of a name
SUFFIX = re.compile(  # likewise
    r"[_ .](deg(?:rees)?|rad(?:ians)?|ms|us|ns|rpm|mm|mA|(?<=current.)A|m?N_?m|(?:deg|rad)(?:_s|ps|_per_s(?:ec)?))$"
)
RAW = re.compile("%|counts?|ticks?|pulses?|raw|inc|turns?|rev|.*[/·^].*|lb[fs]?", re.IGNORECASE)  # of no known size
SI = {
    "q": {"rad": 1.0, "deg": np.pi / 180, "m": 1.0, "mm": 1e-3},
    "qd": {"rad/s": 1.0, "deg/s": np.pi / 180, "rpm": np.pi / 30, "m/s": 1.0, "mm/s": 1e-3},
    "tau": {"Nm": 1.0, "mNm": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3},
}
SI |= {"command": SI["q"], "command_rate": SI["qd"]}
RATES = {"qd": "q", "command_rate": "command"}  # and what they are the rates of
CAUSES = {"tau": "torques", "command": "commands"}  # quantities needed with a motion
TURN = 2 * np.pi  # [rad]
QUANTITIES = '"t", "q", "qd", "tau", "command" and "command_rate"'  # quantities of a log, in errors
SO_ARM, PER_CENT = re.compile("so-?10[01]"), 100.0  # arms whose positions LeRobot has in degrees, or up to 100
SINCE = 1e6  # times beyond this count from the first one [s]
AMBIGUOUS = ("m", "mm", "N")  # units that do not determine the quantity
ORDER = "else name the columns alike"
LIKE = RATES | {"command": "q"}  # quantities whose unit is also that of these
Guesses = list[tuple[str, str]]  # guesses, each with the remedy if it is wrong
Columns = dict[str, dict[str, str]]  # names of columns by quantity and joint


def measured(path: Any, options: LogOptions) -> tuple[dict[str, Any], list[str], Guesses]:
    """Samples of a log, or of a file for each quantity, in units that are given, named in the log, or guessed.

    Returns t, q, tau or command, and their rates in SI units and the names of the joints, how the log was read, and
    guesses with their cures.
    """
    if isinstance(path, Mapping):
        place, log = os.fspath(next(iter(path.values()), "`path`")), _joined(path, options)
    else:
        place, log = os.fspath(path), read_log(Path(path), options)
    log = log._replace(place=place)
    if options.exact:
        return logged(log, options), [], []
    log, rows = with_stamps(log), Guesses()
    if log.long:
        log, options = _wide(log, options, rows)
    reading = Reading(log, options)
    found = reading.by_joint()
    reading.guesses += rows
    kinds, names, said = reading.same_joints(found)
    t, stamp = reading.times(found["t"], len(log.columns[kinds["q"][0]]))
    x = {kind: np.column_stack(reading.numbers(kind, own, len(t))) for kind, own in kinds.items()}
    samples = reading.in_units(x, kinds)
    t, since = reading.seconds(t, stamp, samples)
    said = [*log.said, *said, *since]
    said += [f"{kind}: {_span(own)}" for kind, own in {"t": [stamp] * bool(stamp), **kinds}.items() if own]
    return {"t": t, **samples, "joint_names": names}, said, reading.guesses


def _wide(log: Log, options: LogOptions, guesses: Guesses) -> tuple[Log, LogOptions]:
    """Log with columns, also those given, for each joint, from one with rows for each; NaN where a row is missing."""
    texts, j = _numbered(np.char.strip(log.columns[log.long].astype(str)))
    joints = [re.sub(r"\.0$", "", joint) for joint in texts.tolist()]
    meanings = {name: _meaning(name) for name in log.columns if name != log.long}
    kinds = {name: what.kind or what.command for name, what in meanings.items()}
    given = {kind: _named(log, wanted) for kind, wanted in options.given.items()}
    asked = [name for own in given.values() for name in own]
    stamp = next(iter(given.get("t", [name for name, kind in kinds.items() if kind == "t"])), None)
    if all(joint.isdigit() for joint in joints) and not re.search("joint|axis|motor|servo", log.long, re.IGNORECASE):
        guesses.append((f"column {log.long!r} numbers joints, each of which has rows of its own", "else remove it"))
    times, k = _numbered(_counted(log, j) if stamp is None else log.numbers(stamp))
    if len(np.unique(k * len(joints) + j)) < len(k):
        raise log.error(f"a joint that column {log.long!r} names has two rows at one time; keep one of them")
    if 2 * np.bincount(j).min() <= len(times):
        cure = "interpolate to common ones by numpy.interp, a column for each joint"
        raise log.error(f"joints that column {log.long!r} names have times of their own; {cure}")
    columns, called, of = dict[str, Array](), dict[str, str](), dict[str, str]()
    for name in (name for name, kind in kinds.items() if (kind not in ("", "t") or name in asked) and name != stamp):
        table = np.full((len(times), len(joints)), np.nan)
        table[k, j] = log.numbers(name)
        own = [f"{name}.{joint}" for joint in joints]
        columns |= dict(zip(own, table.T, strict=True))
        called, of = called | dict.fromkeys(own, name), of | dict(zip(own, joints, strict=True))
    columns |= {} if stamp is None else {stamp: times}
    said = (*log.said, f"rows of joints, which column {log.long!r} names")
    made = {name: [x for x in columns if called.get(x, x) == name] for name in asked}
    given = {kind: [x for name in own for x in made[name] or [name]] for kind, own in given.items()}
    return log._replace(columns=columns, called=called, joints=of, said=said), replace(options, columns=given or None)


def _counted(log: Log, j: Array) -> Array:
    """Number of each row among those of its joint, which are as many as of the others."""
    counts = np.bincount(j)
    if np.ptp(counts):
        what = f"joints that column {log.long!r} names have {counts.min()} to {counts.max()} rows"
        raise log.error(f'{what}, and no times that show which are missing; give columns={{"t": ...}}')
    k = np.empty(len(j))
    k[np.argsort(j, kind="stable")] = np.tile(np.arange(counts[0]), len(counts))
    return k


def _numbered(values: Array) -> tuple[Array, Array]:
    """Distinct values in order of appearance, and the index of each entry among them."""
    different, first, k = np.unique(values, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return different[order], np.argsort(order)[k]


class Meaning(NamedTuple):
    """Meaning of a column's name: quantity, joint and unit; for likely commands also the joint of the command."""

    kind: str = ""  # empty if it is none that is read
    joint: str = ""
    unit: str = ""
    own: str | None = None  # the joint's name if the word for a command belongs to it, "" if it cannot; None without
    command: str = ""  # "command" of positions or "command_rate" that it may be, without a word for the quantity too


def _meaning(name: str, joints: Sequence[str] = ()) -> Meaning:
    """Meaning of names such as `q.<joint>`, `actual_current_3`, `joint1 pos [deg]`, `/joint_states/elbow/position`."""
    unit, bare = _unit(name)
    own, _, joint = bare.partition(".")
    if own in ("q", "qd", "tau") and joint:
        return Meaning(own, joint, unit)
    for joint in sorted(joints, key=len, reverse=True):  # names that are given, whatever words are in them
        for match in re.finditer(rf"(?<![^\W_]){re.escape(joint)}(?![^\W_])", name):
            before, after = name[: match.start()], name[match.end() :]
            rest = _meaning(before + after)
            if (rest.kind or rest.command) and (not rest.joint or (before[-1:] in BETWEEN and after[:1] in BETWEEN)):
                return rest._replace(joint=joint)
    split = TOPIC.split(bare)
    tokens = [[word.lower() for word in TOKEN.findall(part)] for part in split]
    words = [word for part in tokens for word in part]
    spare = {word for word in words if SPARE.fullmatch(word)}
    # parts of a name that are a quantity and nothing else
    kinds = [k for k, part in enumerate(tokens) if {*part} - spare and {*part} - spare <= KINDS]
    kinds.sort(key=lambda k: max((WORD.get(x, "q") != "t") + (x in WORD) for x in tokens[k] if x in KINDS))
    asked = {word: found for word in words if (found := ASKED.fullmatch(word))}
    kind = _kind(tokens[kinds[-1]] if kinds else words, unit)
    kind = BY_UNIT.get(unit, kind) if kind in TORQUES else kind
    names = spare | {word for word in KINDS if kind == "t" or WORD.get(word) != "t"}
    told = [COMMANDED.fullmatch(word) for word in asked]
    if (
        not kind
        and told
        and all(x and not x[1] for x in told)
        and unit in ("", *SI["q"])
        and "" not in map(WORD.get, words)
    ):
        rate = "_rate" * ("rate" in words)
        return Meaning("", _joint(split, spare | asked.keys() | {"rate"}), unit, command=f"command{rate}")
    if not kind or (kind == "t" and not all(x in names or CLOCKS.fullmatch(x) for x in tokens[-1])):
        return Meaning()
    parts = [part for k, part in enumerate(split) if k not in kinds[-1:] and not spare.issuperset(tokens[k])][-1:]
    parts, names = (parts, set()) if kinds and parts else (split, names)
    joint, own = _joint(parts, names | asked.keys()), _joint(parts, names)
    own = own if own != joint and all(found[1] for found in asked.values()) else ""
    command = {"q": "command", "qd": "command_rate"}.get(kind, "") if told and all(told) else ""
    return Meaning(kind, joint, unit, own if asked else None, command)


def _unit(name: str) -> tuple[str, str]:
    """Unit at the end of a name, and the name before it; brackets may also hold a joint."""
    if bracket := BRACKETS.search(name):
        unit, bare = symbol(bracket[1]), name[: bracket.start()]
        what = _meaning(bare)
        is_joint = what.kind not in ("", "t") and not (what.joint or UNIT.fullmatch(unit) or RAW.fullmatch(bracket[1]))
        return ("", f"{bare}.{bracket[1]}") if is_joint else (unit, bare)
    suffix = SUFFIX.search(name)
    return (symbol(suffix[1]), name[: suffix.start()]) if suffix else ("", name)


def _kind(words: Sequence[str], unit: str) -> str:
    """Quantity of the last word that names one, as those before it are adjectives: "torque current"."""
    kinds = [WORD[word] for word in words if word in WORD]
    kind = next((kind for kind in reversed(kinds) if kind != "t"), None)
    if kind is None and (not {*SYMBOLS}.isdisjoint(words) or {"observation", "state"} <= {*words}):
        kind = "q"
    if kind is None:
        kind = "t" if kinds else next((x for x in SI if unit in SI[x] and unit not in AMBIGUOUS), "")
    return kind if "dot" not in words else "qd" * (kind == "q")


def _joint(parts: Sequence[str], others: Container[str]) -> str:
    """Last part of a name with words of a joint; topics, namespaces and structures precede it."""
    texts = []
    for part in parts:
        kept = [token for token in TOKEN.finditer(part) if token[0].lower() not in others]
        text = part[kept[0].start() : kept[-1].end()] if kept else ""
        is_whole = len(TOKEN.findall(text)) == len(kept) and not set(text) & set("[(")
        texts.append(text if is_whole else "_".join(token[0] for token in kept))
    last = max((k for k, text in enumerate(texts) if text), default=0)
    matrix = texts[last - 1] if last and parts[last].isdigit() else ""  # of which this is a column
    return f"{matrix}_{texts[last]}" if matrix else texts[last]


def _joined(files: Mapping[str, Any], options: LogOptions) -> Log:
    """Columns of a log with a file for each quantity, of which one has the times, or all the same."""
    columns, log = dict[str, Array](), Log("", {})
    times: dict[str, Array] = {}
    for kind, path in files.items():
        if kind not in ("t", *SI):
            raise ValueError(f"`path` must be a file, or files by {QUANTITIES}, got {kind!r}")
        log = read_log(Path(path), replace(options, quantity=kind))._replace(place=os.fspath(path))
        if log.long:
            cure = "a column for each joint is needed, or one file of all quantities"
            raise log.error(f"has rows of joints, which column {log.long!r} names; {cure}")
        for name in log.columns:
            what, joint, unit, own, command = _meaning(name)
            ending = f" [{unit}]" * bool(unit)
            if "t" in (what, kind):
                times[log.place] = log.numbers(name)
                columns.setdefault("t" + ending, times[log.place])
            elif (what in ("", RATES.get(kind, kind), "q" * (kind == "command")) and own != "") or command == kind:
                columns[f"{kind}.{own or joint or name}{ending}"] = log.numbers(name)
    for place, t in times.items():
        if not np.array_equal(t, next(iter(times.values()))):
            raise ValueError(f"{place}: its times are not those of {next(iter(times))}; interpolate by numpy.interp")
    return log._replace(columns=columns)


class Reading:
    """Log that is read by its options: meanings of its columns, and guesses, each with the remedy if it is wrong."""

    def __init__(self, log: Log, options: LogOptions) -> None:
        self.log, self.options, self.given = log, options, options.given
        self.meanings = {name: _meaning(log.called.get(name, name), options.joints or ()) for name in log.columns}
        self.guesses = Guesses()

    def by_joint(self) -> Columns:
        """Columns of each quantity by joint, as given or else by the meaning of their names."""
        log, options = self.log, self.options
        found, asked, both = self._by_meaning()
        left = self._not_commands(found, asked)
        for x in () if options.torques else TORQUES:
            found[x] = {}
        for kind in ("t", "q", "qd", *self._torques(found)):
            if kind in both and kind not in self.given:
                raise log.error(f"columns {both[kind]}")
        if not (options.torques and found["tau"]) or "command" in self.given:
            self._add_commands(found)
            left = [name for name in left if not found["q"] or name not in found["command"].values()]
        cause = ("tau", "torques or currents") if options.torques and not found["command"] else ("command", "commands")
        for kind, what in (("q", "positions"), cause):
            if not found[kind]:
                alike = [name for name in left if TORQUES.get(asked[name].kind, "q") == kind]
                looks = f"; {_span(alike)} look like commands or errors" if alike else ""
                cure = f'if some are, give columns={{"{kind}": ...}}'
                raise log.error(f"there are no {what}; there are {log.names}{looks}; {cure}")
        if len(log.unused) > 1 and "q" not in self.given and numbers_at_ends(found["q"]):
            there = f"{len(log.unused)} names of joints, {_span(log.unused)}, and {len(found['q'])} numbered positions"
            raise log.error(f'there are {there}; give columns={{"q": ..., "tau": ...}} and `joints`')
        if left:
            self.guesses.append((f"{_span(left)} are commands or errors and not read", "else give `columns`"))
        return found

    def _by_meaning(self) -> tuple[Columns, dict[str, Meaning], dict[str, str]]:
        """Columns by quantity and joint; those that look like commands; pairs of columns for one joint and quantity."""
        log, found = self.log, Columns({kind: {} for kind in (*WORDS, *SI)})
        asked, both, columns = dict[str, Meaning](), dict[str, str](), dict[str, list[str]]()
        for kind, wanted in self.given.items():
            if kind not in ("t", *SI):
                raise ValueError(f"`columns` must be of {QUANTITIES}, got {kind!r}")
            columns[kind] = own = _named(log, wanted)
            names = [log.joints.get(name, self.meanings[name].joint) for name in own]
            names = names if len(set(names)) == len(own) else [*map(str, range(len(own)))]
            found[kind] = dict(zip(names, own, strict=True))
        for name, meaning in self.meanings.items():
            kind, joint = meaning.kind, log.joints.get(name, meaning.joint)
            if not kind or kind in self.given or any(name in own for own in columns.values()):
                continue
            if meaning.own is not None:
                asked[name] = meaning._replace(joint=joint)
            elif f"{kind}.{joint}" == name or f"{kind}.{joint}" not in log.columns:
                if joint in found[kind] and not (kind == "t" and joint):
                    what = f"are both {kind}{f' of {joint}' if joint else ''}"
                    which = f'{what}; say which in columns={{"{TORQUES.get(kind, kind)}": ...}}'
                    if joint and TOPIC.search(name):
                        which += ", or give the joints with more of these names as `joints`"
                    both.setdefault(kind, f"{found[kind][joint]!r} and {name!r} {which}")
                found[kind].setdefault(joint, name)
        return found, asked, both

    def _add_commands(self, found: Columns) -> None:
        """Add the columns of commands, those without a word for the quantity only if there are no others."""
        used = {name for own in found.values() for name in own.values()}
        joints = {*map(plain_name, found["q"]), ""}
        for kind in ("command", "command_rate"):
            own = {name: what for name, what in self.meanings.items() if what.command == kind and name not in used}
            own = {name: what for name, what in own.items() if what.kind} or own
            for name, what in own.items() if kind not in self.given else ():
                joint = self.log.joints.get(name, what.joint)
                if not (what.kind or joint.isdigit() or plain_name(joint) in joints):
                    continue
                first = found[kind].setdefault(joint, name)
                if not np.array_equal(self.log.numbers(first), self.log.numbers(name), equal_nan=True):
                    what_for = f"may both be commands{f' of {joint}' if joint else ''}"
                    cure = f'give columns={{"{kind}": ...}}'
                    raise self.log.error(f"columns {first!r} and {name!r} {what_for}; {cure}")

    def _torques(self, found: Columns) -> list[str]:
        """Take currents and forces as torques where no joint has two of these, and return the kinds present.

        If a log has both torques and currents, their units must be known.
        """
        kinds = [kind for kind in ("tau", "current") if found[kind]][:1]
        found["tau"] = tau = dict(found[kinds[0]] if kinds else {})
        for kind in ("current", "force") if "tau" not in self.given else ():
            own = {x: name for x, name in found[kind].items() if x in found["q"]}
            names = [*tau.values(), *own.values()]
            is_clear = "current" not in (kind, *kinds) or all(self.meanings[x].unit for x in names)
            if own and is_clear and own.keys().isdisjoint(tau):
                if kind == "force":
                    self._check_forces(own, found["q"])
                tau |= own
                kinds.append(kind)
        return kinds

    def _check_forces(self, forces: dict[str, str], q: Mapping[str, str]) -> None:
        """Raise a ValueError for forces by joint, which are the torques of sliding joints, of joints that rotate."""
        given = self.options.units
        unit = given.get("q") if isinstance(given, Mapping) else None
        units = {x: unit if isinstance(unit, str) else self.meanings[q[x]].unit for x in forces}
        if turning := [name for x, name in forces.items() if units[x] in ("rad", "deg")]:
            cure = 'if they are torques, give columns={"tau": ...}'
            raise self.log.error(f"{_span(turning)} are forces, and the positions of their joints angles; {cure}")
        if unsaid := [name for x, name in forces.items() if units[x] not in ("m", "mm")]:
            self.guesses.append((f"{_span(unsaid)} are forces of joints that slide", 'else give units={"q": ...}'))

    def _not_commands(self, found: Columns, asked: Mapping[str, Meaning]) -> list[str]:
        """Add the columns of joints named like commands, and return those of commands without a measured one.

        Such a joint has a position and a torque, as other joints do, and no column without the word belongs to it.
        """
        torques, order = found["tau"] | found["current"], list(self.log.columns)
        alone = {x: m for x, m in asked.items() if m.joint not in (torques if m.kind == "tau" else found[m.kind])}
        own = {(m.kind, plain_name(m.own)): name for name, m in alone.items() if m.own}
        for (kind, key), name in own.items():
            torque = next((x for x in TORQUES if (x, key) in own), None)
            if kind == "q" and torque and found["q"] and torques:
                joint = str(alone[name].own)
                self.guesses.append((f"{name!r} is of a joint {joint!r}, not a command", "else give `columns`"))
                for x in ("q", "qd", torque):
                    if column := own.get((x, key)):
                        found[x][joint] = column
                        del alone[column]
        found["q"] = dict(sorted(found["q"].items(), key=lambda x: order.index(x[1]))) if asked else found["q"]
        return [name for name, m in alone.items() if m.kind not in ("t", "qd")]

    def same_joints(self, found: Columns) -> tuple[dict[str, list[str]], Sequence[str] | None, list[str]]:
        """Columns of each quantity for the same joints, their names, None for numbers, and the omitted ones.

        Names come before numbers, and numbers before the order in the file, unless the columns are given.
        """
        joints, causes = self.options.joints, [kind for kind in CAUSES if found[kind]]
        there = {kind: found[kind] for kind in ("q", *causes, "qd", *["command_rate"] * ("command" in causes))}
        are_given = {"q", *causes} <= self.given.keys()
        of, key = self._by_names(there, are_given)
        common = self._chosen(there, of, key, are_given)
        alone = [joint for joint in of["q"] if not all(joint in of[kind] for kind in causes)]
        for kind in there.keys() & RATES.keys():
            if set(common) - of[kind].keys():
                del of[kind]
        for kind in [*there][1:]:
            kept = {x for joint, x in of.get(kind, {}).items() if joint in of["q"]}
            if lost := [x for x in there[kind].values() if x not in kept]:
                self.guesses.append((f"{_span(lost)} are not of the joints of the positions and not read", ORDER))
        if joints is None and all(joint.isdigit() or not joint for joint in common):
            k = [int(joint or 1) for joint in common]
            joints = [] if k == list(range(k[0], k[0] + len(k))) and k[0] < 2 else [f"joint_{i + (0 in k)}" for i in k]
            if len(common) > 1:
                guess = "numbered columns are taken in the robot's order"
                self.guesses.append((guess, "else give their names as `joints`"))
        named = common if joints is None else joints
        said = [f"without {' or '.join(CAUSES[x] for x in causes)}, left out: {listed_names(alone)}"] * bool(alone)
        return {kind: [x[joint] for joint in common] for kind, x in of.items()}, named or None, said

    def _by_names(self, there: Columns, are_given: bool) -> tuple[Columns, Callable[[str], str]]:
        """Columns of each quantity by the names of joints of that which has names, and the rule that matches names."""
        numbers = {kind: numbers_at_ends(x) for kind, x in there.items()}
        for kind, k in numbers.items():
            if k and not are_given:
                there[kind] = dict(x for _, x in sorted(zip(k, there[kind].items(), strict=True)))
        other = [kind for kind, x in there.items() if x and not numbers[kind]]
        # Velocities may be of more than the joints.
        first = next((kind for kind in other if kind not in RATES or len(there[kind]) == len(there["q"])), "q")
        names, of = there[first], Columns()
        are_different = all(len({*map(plain_name, x)}) == len(x) for x in there.values())
        key: Callable[[str], str] = plain_name if are_different else str
        for kind, x in there.items():
            own, k, base = {key(joint): column for joint, column in x.items()}, numbers[kind], numbers[first]
            is_shifted = k and base and (0 in k) != (0 in base)
            of[kind] = {joint: own[key(joint)] for joint in names if key(joint) in own and not is_shifted}
            if not of[kind] and len(x) == len(names) and (k or are_given):
                of[kind] = dict(zip(names, x.values(), strict=True))
                if kind not in RATES and not are_given:
                    guess = f"{_span(x)} are of the joints of {_span(names)} in this order"
                    self.guesses.append((guess, ORDER))
        return of, key

    def _chosen(self, there: Columns, of: Columns, key: Callable[[str], str], are_given: bool) -> list[str]:
        """Joints with positions and torques in the order of those asked for, or all."""
        joints, causes = self.options.joints, [kind for kind in CAUSES if kind in there]
        said = " and ".join(CAUSES[kind] for kind in causes)
        which = "columns={" + ", ".join(f'"{kind}": ...' for kind in ("q", *causes)) + "}"
        common = [joint for joint in of["q"] if all(joint in of[kind] for kind in causes)]
        own = {key(joint): joint for joint in common}
        shared = own.keys() & set(map(key, joints or ()))
        are_others = len(joints or ()) == len(common) and len(shared) < len(common)
        if not common:
            both = ", ".join(f"{CAUSES[kind]} {_span(there[kind])}" for kind in causes)
            cure = f"if these are of the same joints, give {which} in the same order"
            raise self.log.error(
                f"no joint has positions and {said}; positions are {_span(there['q'])}, {both}; {cure}"
            )
        if joints is None or (are_others and are_given):
            return common
        if are_others and numbers_at_ends(common) and not shared:
            self.guesses.append((f"{_span(of['q'])} are of {_span(joints)} in this order", ORDER))
            return common
        if missing := [joint for joint in joints if key(joint) not in own]:
            hint = did_you_mean(missing[0], common) or f"; there are {listed_names(common, LISTED)}"
            cure = f"; to name them so, give {which} in the order of `joints`" * are_others
            raise self.log.error(f"there are no positions and {said} of joint {missing[0]!r}{hint}{cure}")
        return [own[key(joint)] for joint in joints]

    def times(self, found: Mapping[str, str], count: int) -> tuple[Array, str]:
        """Times in the unit of the log, and their column; in seconds and without a column from the sample rate."""
        if self.options.sample_rate is not None:
            return np.arange(count) / positive_number("sample_rate", self.options.sample_rate), ""
        if not found:
            cure = 'give columns={"t": ...} or `sample_rate`'
            raise self.log.error(f"there are no times; there are {self.log.names}; {cure}")
        t = self.log.numbers(stamp := found[min(found)])
        if missing := np.flatnonzero(~np.isfinite(t)).tolist():
            raise self.log.error(f"the time of sample {missing[0]} is missing")
        return t, stamp

    def numbers(self, kind: str, names: Sequence[str], count: int) -> list[Array]:
        """Columns as numbers, one for each time."""
        columns = [self.log.numbers(name) for name in names]
        if sizes := {len(column) for column in columns} - {count}:
            raise self.log.error(f"there are {count} times and {min(sizes)} samples of {kind}")
        return columns

    def in_units(self, x: Mapping[str, Array], kinds: Mapping[str, Sequence[str]]) -> dict[str, Any]:
        """Samples in SI units, by quantity; `kinds` are the names of their columns."""
        units, n = self._units(kinds), x["q"].shape[1]
        if self.log.is_lerobot and "q" not in self.options.units:
            units["q"] = self._unit_of_data_set(x, kinds["q"])
        if "command" in x and units["q"] is None:
            self._refuse_counts(x["q"], kinds["q"])
        if units["q"] is None and np.mean(np.nanmax(np.abs(x["q"]), axis=0, initial=0) > 2 * TURN) > 0.5:
            self.guesses.append(("positions are in degrees, as most pass two turns", 'else give units={"q": "rad"}'))
            units["q"] = "deg"
        zero = per_joint_array("offsets", self.options.offsets, n)
        samples: dict[str, Any] = {"tau": None, "qd": None}
        for kind in (kind for kind in SI if kind in x):
            if units[kind] is None and kind in LIKE:
                units[kind] = units[LIKE[kind]]
            samples[kind] = x[kind] * _in_si(kind, units[kind], n)
        if "tau" in x:
            samples["tau"] *= self._gains(kinds["tau"], units["tau"], n)
        for kind in {"q", "command"} & x.keys():
            samples[kind] += zero
        return samples

    def _units(self, kinds: Mapping[str, Sequence[str]]) -> dict[str, Any]:
        """Units that are given or stated in the names of all columns of a quantity, else None; of currents A or mA."""
        given = self.options.units
        if not isinstance(given, Mapping) or set(given) - set(SI):
            raise ValueError(f"`units` must be a mapping of {QUANTITIES[5:]}, got {given!r}")
        units: dict[str, Any] = dict.fromkeys(SI) | dict(given)
        unit_of = {name: x.unit or ("A" if x.kind == "current" else None) for name, x in self.meanings.items()}
        for kind in (kind for kind in kinds if kind not in given):
            named = {unit_of[name]: name for name in kinds[kind]}
            if kind == "command" and "q" in given and not named.keys() & SI["q"].keys():
                continue  # in the unit that is given for the positions
            cure = f"give units={{{kind!r}: ...}}"
            if unknown := [unit for unit in named if unit not in (None, *_known(kind))]:
                cure += ", by name or as SI units per unit of the log"
                raise self.log.error(f"the unit {unknown[0]!r} of column {named[unknown[0]]!r} is not known; {cure}")
            if len(named) > 1 and None in named:
                raise self.log.error(f"some of the columns {_span(kinds[kind])} name no unit; {cure}")
            units[kind] = [unit_of[name] for name in kinds[kind]] if len(named) > 1 else next(iter(named))
        return units

    def _gains(self, names: Sequence[str], units: Any, n: int) -> Array:
        """Torques per unit of the log's torque columns, shape (n,); must be given for currents."""
        gains = self.options.gains
        are_currents = np.isin(np.asarray(units, dtype=object), ["A", "mA"]).any()
        if gains is None and (are_currents or any(self.meanings[x].kind == "current" for x in names)):
            cure = "give `gains` [N m/A]; gains=1 keeps currents, for `rne.identify_drive_gains`"
            motors = "at motors behind gears, Record.from_motors takes `drive_gains`"
            raise self.log.error(f"{_span(names)} are currents, not torques; {cure}; {motors}")
        factors = per_joint_array("gains", 1 if gains is None else gains, n)
        if not factors.all():
            raise ValueError(f"`gains` must not be zero, got {gains!r}")
        return factors

    def _unit_of_data_set(self, x: Mapping[str, Array], names: Sequence[str]) -> str:
        """Unit degrees, where an SO-100 or SO-101 exceeds the range of normalised positions."""
        cure, arm = 'give units={"q": "deg"}, or rad per unit of each joint and `offsets`', self.log.robot
        if "command" not in x or not SO_ARM.match(arm) or np.nanmax(np.abs(x["q"]), initial=0) <= PER_CENT:
            raise self.log.error(f"positions of LeRobot data sets are in degrees or normalised; {cure}")
        if gripper := [name for name in names if "gripper" in name]:
            cure = "give `joints` without it, or units={{'q': ...}} with one of each joint"
            raise self.log.error(f"{gripper[0]!r} is in per cent of its range, and the others in degrees; {cure}")
        guess = f"positions of {arm} are in degrees, as some pass {PER_CENT:g}"
        self.guesses.append((guess, 'else give units={"q": ...}'))
        return "deg"

    def _refuse_counts(self, q: Array, names: Sequence[str]) -> None:
        """Raise a ValueError for whole numbers, which may be degrees or steps of encoders."""
        known = q[np.isfinite(q)]
        if known.size and np.ptp(known) > 2 * TURN and (known == np.rint(known)).all():
            cure = 'give units={"q": "deg"}, or rad per step, such as 2 * pi / 4096, and `offsets`'
            numbers = f"whole numbers from {known.min():g} to {known.max():g}"
            raise self.log.error(f"{_span(names)} are {numbers}, degrees or steps; {cure}")

    def seconds(self, t: Array, stamp: str, samples: Mapping[str, Any]) -> tuple[Array, list[str]]:
        """Times in seconds, by their column and the unit named in the log, and remarks on dates."""
        said = self.log.time_unit or self.meanings.get(stamp, Meaning()).unit
        unit = self.options.time_unit or said if stamp else "s"
        if not unit and (seems := guessed_unit(t, samples["q"], samples["qd"])) is not None:
            self.guesses.append((f"column {stamp!r} {seems.said}", 'else give time_unit="s"'))
            unit = seems.symbol
        if stamp and self.options.time_unit is None and unit not in (None, "", "s", "ms", "us", "ns"):
            cure = "give `time_unit`, or `sample_rate` instead of the times"
            raise self.log.error(f"the unit {unit!r} of column {stamp!r} is not known; {cure}")
        t = in_seconds(self.log.place, Samples(t), unit or "s").t
        return (t - t[0], [f"times from the first sample on, at {t[0]:.3f} s"]) if t[0] > SINCE else (t, [])


def _named(log: Log, wanted: Any) -> list[str]:
    """Columns of a name or number, or of several; of a matrix all."""
    if not isinstance(wanted, str | int):
        return [name for part in wanted for name in _named(log, part)]
    names = list(log.columns)
    own = [x for k, x in enumerate(names) if wanted in (x, k)] or [x for x in names if x.startswith(f"{wanted}.")]
    if not own:
        hint = did_you_mean(str(wanted), names) or f"; there are {log.names}"
        raise log.error(f"there is no column {wanted!r}, which `columns` asks for{hint}")
    return own


def plain_name(joint: str) -> str:
    """Joint's name without the parts that two columns may write differently."""
    return re.sub(r"[\W_]", "", joint).casefold()


def numbers_at_ends(joints: Iterable[str]) -> list[int]:
    """Numbers at the ends of names that are otherwise equal, 1 for a joint without a name; empty for others."""
    ends = [re.fullmatch(r"(.*?)(\d*)", joint) for joint in joints]
    parts = [end.groups() for end in ends if end]
    alike = len({name for name, _ in parts}) == 1 and all(number or not name for name, number in parts)
    return [int(number or 1) for _, number in parts] * alike


def names_by_number(own: Sequence[str], others: Sequence[str]) -> list[str]:
    """Names of `others` with the numbers of one's own: arm_j2 for joint_2 or j2; empty if they do not match."""
    k, theirs = numbers_at_ends(own), numbers_at_ends(others)
    if not k or not set(own).isdisjoint(others) or not set(k) <= set(theirs) or (0 in k) != (0 in theirs):
        return []
    stem, whole = (plain_name(x[0].rstrip("0123456789")) for x in (own, others))
    called = dict(zip(theirs, others, strict=True))
    return [called[i] for i in k] if stem == "joint" or whole.endswith(stem) else []  # else another arm's


def _known(kind: str) -> dict[str, float]:
    """Units of a quantity and their factors; a rate may be in those of its positions, per second."""
    return SI["q"] | SI["qd"] if kind in RATES else SI[kind]


def _in_si(kind: str, unit: Any, n: int) -> Array:
    """Factors to SI units of one unit for all joints, or one of each, by name or as a number; ones for None."""
    if unit is None:
        return np.ones(n)
    known = _known(kind)
    units = [unit] * n if isinstance(unit, str | int | float) else list(unit)
    if len(units) != n or any(symbol(x) not in known if isinstance(x, str) else not x for x in units):
        wanted = f"{', '.join(map(repr, SI[kind]))}, or a number of SI units, for all or {n} joints"
        raise ValueError(f"`units` of {kind} must be {wanted}, got {unit!r}")
    factors = [known[symbol(x)] if isinstance(x, str) else x for x in units]
    return per_joint_array(f"units of {kind}", factors, n)


def _span(names: Sequence[str] | dict[str, str]) -> str:
    """First and last name, of columns by joint those of the columns."""
    names = [*names.values()] if isinstance(names, dict) else names
    first, last = (repr(cut(names[k], MAX_NAME)) for k in (0, -1))
    return first if len(names) == 1 else f"{first} to {last}"
