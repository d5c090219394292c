"""Tables of a command exchange over injected time: what is done, and what comes of it."""

from __future__ import annotations

from google.protobuf.message import Message

from autopilot.adapters.vehicle.commands import Exchange, Send
from autopilot.adapters.vehicle.heard import Answer, Sender
from autopilot.adapters.vehicle.modes import Kind
from autopilot.adapters.vehicle.orders import COMMAND_OF, order_of
from autopilot.ports.config import VehicleSection
from events.schema.vehicle_pb2 import CommandAnswered, CommandSent, CommandUnanswered
from tests.autopilot.vehicle.vehicles import arm, at_angles, at_place, fly_to, go_to_item, mode, release, start

AUTOPILOT = Sender(system=1, component=1)
US = Sender(system=1, component=191)
EFFECTS: dict[str, Message] = {
    "place": at_place(),
    "angles": at_angles(),
    "release": release(),
    "rtl": mode("RETURN"),
    "land": mode("LAND"),
    "ordered_rtl": mode("RETURN", order="alice/1"),
    "loiter": mode("LOITER", order="alice/2"),
    "guided": mode("GUIDED"),
    "arm": arm(),
    "start": start(),
    "item": go_to_item(3),
    "fly": fly_to(),
}
COPTER, PX4 = Kind(autopilot=3, vehicle_type=2), Kind(autopilot=12, vehicle_type=2)
COMMANDS = {name: COMMAND_OF[type(effect)] for name, effect in EFFECTS.items()}
MS = 1_000_000


def do(exchange: Exchange, now_ns: int, words: list[str], kind: Kind = COPTER) -> str:
    """`order SEQ KIND LIFE_MS`, `sent SEQ`, `answer KIND RESULT [PROGRESS]`, `aim on|off`, `tick`."""
    match words:
        case ["order", seq, name, life_ms]:
            exchange.submit(now_ns, order_of(int(seq), EFFECTS[name], now_ns + int(life_ms) * MS, kind))
        case ["sent", seq]:
            exchange.sent(int(seq))
        case ["answer", name, result, *progress]:
            percent = int(progress[0]) if progress else 0
            answer = Answer(sender=AUTOPILOT, command=COMMANDS[name], result=int(result), progress=percent, target=US)
            heard = exchange.hear(now_ns, answer)
            return heard if isinstance(heard, str) else ""
        case ["aim", word]:
            exchange.aim(AUTOPILOT if word == "on" else None)
        case ["tick"]:
            exchange.tick(now_ns)
    return ""


def _said(item: Send | Message) -> str:
    match item:
        case Send():
            other = "" if item.form is item.order.form else f" as {item.form.name}"
            return f"send {item.order.effect_seq} #{item.confirmation}{other}"
        case CommandSent():
            return f"sent {item.effect_seq}"
        case CommandAnswered():
            return f"answered {item.effect_seq} {item.mav_result} {item.progress}% of {item.attempts}"
        case CommandUnanswered():
            return f"unanswered {item.effect_seq} {item.because} of {item.attempts}"
    return "unexpected"


def check_exchange(table: str, kind: Kind = COPTER) -> None:
    """Run a table of `at_ms | do | expected; expected`; what is not believed is expected in brackets."""
    settings = VehicleSection(
        answer_timeout_s=0.7, attempts=3, in_progress_timeout_s=3, in_progress_longest_s=10, late_answer_s=3
    )
    exchange = Exchange(settings)
    exchange.aim(AUTOPILOT)
    for line in table.strip().splitlines():
        at_ms, words, expected = (cell.strip() for cell in line.split("|"))
        wrong = do(exchange, int(at_ms) * MS, words.split(), kind)
        said = [*map(_said, exchange.take()), *([f"({wrong})"] if wrong else [])]
        assert "; ".join(said) == expected, line
