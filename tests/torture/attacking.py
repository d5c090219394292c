"""The attacks: each kind takes a folder of flights and changes it, as drawn from a seed. Nothing here judges it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import sign_note
from autopilot.trust.replayed import VERDICT_FILE
from events.records import Moment, Stored
from events.store.flights import DATABASE, flights_in
from events.store.head import NAME as HEAD
from tests.autopilot.trust.world import people
from tests.torture.forging import (
    OBSERVATIONS,
    SIGNER,
    Log,
    Skill,
    continued,
    linked_anew,
    logs_in,
    sealed_anew,
)

Files = Mapping[str, bytes]
BEGUN = 6  # records that each flight begins with; a fork keeps them


@dataclass
class Attacker:
    """Who holds the disk: chance, the keys that could be read while flights were open, and old copies of all."""

    root: Path
    chance: Random
    keys: dict[int, SignKey]
    copies: list[Files]
    skill: Skill = Skill.CRUDE
    relinked: bool = False
    logs: list[Log] = field(default_factory=list)

    def begin(self) -> None:
        """Read everything, and draw how far to go."""
        self.logs = logs_in(self.root)
        self.skill = self.chance.choice(list(Skill))
        self.relinked = self.skill is not Skill.CRUDE and self.chance.random() < 0.5

    def draw(self) -> Log:
        """Draw a flight; the newest is the likeliest."""
        return self.chance.choice([*self.logs, self.logs[-1]])


def _resealed(attacker: Attacker, log: Log, first: int) -> None:
    """Put a changed log back, with everything made to fit that the attacker can make fit."""
    before = Log.read(log.flight)
    sealed_anew(log, attacker.skill, attacker.keys, first, before)
    log.write(head=attacker.skill is not Skill.CRUDE)
    if not attacker.relinked:
        return
    at = attacker.logs.index(log)
    for after in linked_anew(attacker.logs[at:]):
        sealed_anew(after, attacker.skill, attacker.keys, 0, Log.read(after.flight))
        after.write(head=True)


def _renumbered(rows: list[Stored], at: int, by: int) -> list[Stored]:
    return [row._replace(seq=seq, cause=row.cause + by * (row.cause >= at)) for seq, row in enumerate(rows)]


def edit_body(attacker: Attacker) -> None:
    """One byte of a body."""
    log = attacker.draw()
    seq = attacker.chance.choice([row.seq for row in log.rows if row.body])
    body = bytearray(log.rows[seq].body)
    body[attacker.chance.randrange(len(body))] ^= 1 << attacker.chance.randrange(8)
    log.rows[seq] = log.rows[seq]._replace(body=bytes(body))
    _resealed(attacker, log, seq)


def edit_header(attacker: Attacker) -> None:
    """One number of a header: a cause, a moment, a kind, a version."""
    log = attacker.draw()
    row = attacker.chance.choice(log.rows)
    name = attacker.chance.choice(("cause", "kind_number", "version", *Moment._fields))
    if name in Moment._fields:
        at = row.at._replace(**{name: getattr(row.at, name) + attacker.chance.randrange(1, 9)})
        log.rows[row.seq] = row._replace(at=at)
    else:
        log.rows[row.seq] = row._replace(**{name: getattr(row, name) + attacker.chance.randrange(1, 9)})
    _resealed(attacker, log, row.seq)


def insert(attacker: Attacker) -> None:
    """A record that stands elsewhere, a second time."""
    log = attacker.draw()
    seq, copied = attacker.chance.randrange(1, len(log.rows) + 1), attacker.chance.choice(log.rows)
    log.rows = _renumbered([*log.rows[:seq], copied, *log.rows[seq:]], seq, 1)
    _resealed(attacker, log, seq)


def delete(attacker: Attacker) -> None:
    """A record in the middle."""
    log = attacker.draw()
    seq = attacker.chance.randrange(len(log.rows) - 1)
    rows = [*log.rows[:seq], *log.rows[seq + 1 :]]
    log.rows = rows if attacker.skill is Skill.CRUDE else _renumbered(rows, seq, -1)
    _resealed(attacker, log, seq)


def swap(attacker: Attacker) -> None:
    """Two records exchanged."""
    log = attacker.draw()
    one, other = sorted(attacker.chance.sample(range(len(log.rows)), 2))
    first, second = log.rows[one], log.rows[other]
    log.rows[one], log.rows[other] = second._replace(seq=one), first._replace(seq=other)
    _resealed(attacker, log, one)


def cut(attacker: Attacker) -> None:
    """The end."""
    log = attacker.draw()
    count = attacker.chance.randrange(1, len(log.rows))
    log.rows = log.rows[:count]
    if attacker.skill in (Skill.KEPT_SIGNATURES, Skill.CHAINED):
        attacker.skill = Skill.BARE  # what is left is genuine: the signatures over it still hold
    _resealed(attacker, log, count)


def fork(attacker: Attacker) -> None:
    """Another history from some step on, that the charts would have decided just so."""
    log = attacker.draw()
    begins = [row.seq for row in log.rows if row.seq >= BEGUN and row.kind_number in OBSERVATIONS]
    first = attacker.chance.choice([*begins, len(log.rows)]) if not log.closed else attacker.chance.choice(begins)
    length = max(first + attacker.chance.randrange(1, 30), len(log.rows) - 5)
    east_mm = 200_000 + attacker.chance.randrange(90_000)
    log.rows = continued(log.rows[:first], length, east_mm, close=log.closed)
    if attacker.skill is Skill.CRUDE:
        attacker.skill, attacker.relinked = Skill.LIVE_KEY, True
    _resealed(attacker, log, first)


def roll_back(attacker: Attacker) -> None:
    """Everything, or the newest flight alone, as it once was."""
    copy = attacker.chance.choice(attacker.copies)
    whole = attacker.chance.random() < 0.7
    newest = max(name.split("/")[0] for name in copy)
    if whole:
        shutil.rmtree(attacker.root)
    else:
        shutil.rmtree(attacker.root / newest)
    write({name: data for name, data in copy.items() if whole or name.startswith(newest)}, attacker.root)


def delete_flight(attacker: Attacker) -> None:
    """A whole flight, or its log alone."""
    flight = attacker.chance.choice(attacker.logs).flight
    if attacker.chance.random() < 0.5:
        shutil.rmtree(flight.folder)
    else:
        for file in flight.folder.glob(f"{DATABASE}*"):
            file.unlink()


def swap_flights(attacker: Attacker) -> None:
    """The logs of two flights exchanged, or one laid in the place of the other."""
    one, other = attacker.chance.sample([log.flight.folder for log in attacker.logs], 2)
    files = {name: (one / name).read_bytes() for name in (DATABASE, HEAD)}
    for name in files:
        shutil.copy(other / name, one / name)
    for name, data in files.items():
        if attacker.chance.random() < 0.5:
            (other / name).write_bytes(data)


def take_checkpoints(attacker: Attacker) -> None:
    """The side table: all of it, or the newest notes; the head file is made to fit."""
    log = attacker.chance.choice([log for log in attacker.logs if log.checkpoints])
    sizes = sorted(log.checkpoints)
    keep = attacker.chance.choice((0, attacker.chance.randrange(len(sizes))))
    log.checkpoints = {size: log.checkpoints[size] for size in sizes[:keep]}
    log.write(head=attacker.skill is not Skill.CRUDE)


def spoil_checkpoint(attacker: Attacker) -> None:
    """A note: one character, another size, another flight's, or a signature by a key of his own."""
    log = attacker.chance.choice([log for log in attacker.logs if log.checkpoints])
    size = attacker.chance.choice(sorted(log.checkpoints))
    note = log.checkpoints[size]
    other = attacker.chance.choice([one for one in attacker.logs if one.checkpoints and one is not log])
    place = attacker.chance.randrange(len(note))
    text = note.rpartition("\n\n")[0] + "\n"
    log.checkpoints[size] = attacker.chance.choice(
        (
            f"{note[:place]}{'x' if note[place] != 'x' else 'y'}{note[place + 1 :]}",
            note.replace(f"\n{size}\n", f"\n{size + 1}\n"),
            other.checkpoints[min(other.checkpoints)],
            sign_note(text, text.partition("\n")[0], people().hornet.sign_key),
        )
    )
    log.write(head=True)


def spoil_papers(attacker: Attacker) -> None:
    """Certificate, verdict or head file: taken away, or exchanged for those of another flight, or written anew."""
    judged = [flight for flight in flights_in(attacker.root) if (flight.folder / VERDICT_FILE).exists()]
    name = attacker.chance.choice((CERTIFICATE_FILE, VERDICT_FILE, HEAD))
    flight = attacker.chance.choice(judged if name == VERDICT_FILE else flights_in(attacker.root))
    others = [one for one in (judged if name == VERDICT_FILE else flights_in(attacker.root)) if one != flight]
    path = flight.folder / name
    draw: list[Callable[[], object]] = [path.unlink]
    if others:
        draw.append(lambda: shutil.copy(attacker.chance.choice(others).folder / name, path))
    if name == VERDICT_FILE:
        text = path.read_text("utf-8").rpartition("\n\n")[0].replace("REPLAYS", "DIVERGES@7") + "\n"
        draw.append(lambda: path.write_text(sign_note(text, SIGNER, people().hornet.sign_key), encoding="utf-8"))
        draw.append(lambda: path.write_text(sign_note(text, SIGNER, attacker.keys[flight.number]), encoding="utf-8"))
    attacker.chance.choice(draw)()


KINDS: dict[str, Callable[[Attacker], None]] = {
    "edit a body": edit_body,
    "edit a header": edit_header,
    "insert": insert,
    "delete": delete,
    "swap": swap,
    "cut": cut,
    "fork": fork,
    "roll back": roll_back,
    "delete a flight": delete_flight,
    "swap flights": swap_flights,
    "take checkpoints": take_checkpoints,
    "spoil a checkpoint": spoil_checkpoint,
    "spoil papers": spoil_papers,
}


def write(files: Files, root: Path) -> None:
    """Lay files below a folder."""
    for name, data in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
