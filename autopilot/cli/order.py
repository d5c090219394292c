"""`autopilot order`: an operator's orders from a shell.

One order a call, answered before it returns, or a look at a node's status; the work is
`autopilot.ground.issuer`'s.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from google.protobuf.json_format import MessageToDict

from autopilot.cli.order_flight import EXAMPLES as FLIGHT_EXAMPLES
from autopilot.cli.order_flight import add_flight_verbs, flight_words
from autopilot.ground import compose
from autopilot.ground.following import Pointing
from autopilot.ground.issued import FILE, AuditRow, IssuedStore, NotRecorded
from autopilot.ground.issuer import Issuer
from autopilot.ground.ledger import Answer, Order
from autopilot.ground.statuses import SeenStatus
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.identity import IdentityError, load_identity
from autopilot.trust.limits import KEY_BYTES, ORDER_TTL_MS, TTL_MS_MAX
from events.schema.waypoint_pb2 import CameraStatus, DeviceCommand, NodeStatus

_EXAMPLES = f"""\
examples:
  autopilot order roi 52.1000 4.3000 12 --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order look -30 90 --north --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order look -30 90 --until arrived --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order zoom 40 --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order confirm 0190b5a2-... --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order watch --attend --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order watch --seconds 10 --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order may --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order history --identity keys/alice
{FLIGHT_EXAMPLES}
exit codes: 0 accepted (with --until arrived: and arrived), 1 rejected or not carried out, 69 no answer, 74 it could not
be recorded and did not leave, 77 not permitted, 78 identity unusable
"""
_FOUND_WITHIN_S = 10.0  # a node publishes its status every second; this allows for a slow link
_EXIT = {"accepted": os.EX_OK, "unauthorised": os.EX_NOPERM}

Compose = Callable[[argparse.Namespace], DeviceCommand]


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to `commands`."""
    parser = commands.add_parser(
        "order",
        help="an operator's orders: roi, look, zoom, release, confirm, decline, follow, fly, mode, mission, and more",
        description="Give a node an order and wait for its answer, watch its status, or look at what was ordered.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    roi = _verb(
        verbs, "roi", "point the camera at a place", lambda a: compose.point_at_place(a.lat, a.lon, a.alt, a.camera)
    )
    roi.add_argument("lat", type=_number(90), help="latitude, degrees north")
    roi.add_argument("lon", type=_number(180), help="longitude, degrees east")
    roi.add_argument("alt", type=_number(20_000), help="altitude above mean sea level, metres")
    look = _verb(
        verbs,
        "look",
        "point the camera by angles",
        lambda a: compose.point_at_angles(a.pitch, a.yaw, north=a.north, camera=a.camera),
    )
    look.add_argument("pitch", type=_number(90), help="degrees, up positive")
    look.add_argument("yaw", type=_number(360), help="degrees clockwise from the nose")
    look.add_argument("--north", action="store_true", help="yaw counts from north and is held there")
    for pointing in (roi, look):
        pointing.add_argument("--until", choices=["answered", "arrived"], default="answered", help="how long to wait")
    zoom = _verb(verbs, "zoom", "zoom the camera", lambda a: compose.zoom(a.percent, a.camera))
    zoom.add_argument("percent", type=_share, help="0 is widest, 100 is closest")
    _verb(verbs, "release", "give the camera back", lambda a: compose.release(a.camera))
    for word, confirmed in (("confirm", True), ("decline", False)):
        judge = _verb(verbs, word, f"{word} a finding", _judgement(confirmed=confirmed))
        judge.add_argument("poi", metavar="POI", help="id of the finding, as the status shows it")
    add_flight_verbs(lambda name, words, command: _verb(verbs, name, words, command), _number)
    watch = _verb(verbs, "watch", "show the node's status as it changes", None)
    watch.add_argument(
        "--attend",
        action="store_true",
        help="tell the node each second that you are there: without a word of an operator it comes home",
    )
    watch.add_argument("--seconds", type=float, default=float("inf"), metavar="N", help="stop after N seconds")
    may = _verb(verbs, "may", "say what this operator may do on the node, and why not", None)
    may.set_defaults(look=_may)
    _add_history(verbs)


def _add_history(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    words = "show what was ordered with this identity here, and what came of it"
    history = verbs.add_parser("history", help=words, description=f"{words[0].upper()}{words[1:]}.")
    history.add_argument("--identity", required=True, metavar="FOLDER", help="folder of the operator's identity")
    history.add_argument("--json", action="store_true", help="one JSON object a row")
    history.set_defaults(run=run_history)


def _verb(
    verbs: argparse._SubParsersAction[argparse.ArgumentParser], name: str, words: str, command: Compose | None
) -> argparse.ArgumentParser:
    parser = verbs.add_parser(name, help=words, description=f"{words[0].upper()}{words[1:]}.")
    parser.add_argument("--identity", required=True, metavar="FOLDER", help="folder of the operator's identity")
    parser.add_argument("--connect", required=True, action="append", metavar="tcp/HOST:PORT", help="Zenoh endpoint")
    parser.add_argument("--to", required=True, metavar="NODE", help="principal id of the node")
    parser.add_argument("--node-key", type=_key, metavar="HEX", help="the node's public key, where it is not known yet")
    parser.add_argument("--camera", type=int, default=1, metavar="N", help="camera, from 1")
    parser.add_argument("--life", type=_life, default=ORDER_TTL_MS / 1000, metavar="S", help="how long it may be tried")
    parser.add_argument("--json", action="store_true", help="answer as JSON")
    parser.set_defaults(run=run, compose=command, look=_watch)
    return parser


def run(args: argparse.Namespace) -> int:
    """Give the order that `args` holds, or watch; return the exit code."""
    try:
        identity = load_identity(args.identity, wall_ms(HostClock()))
    except IdentityError as error:
        print(error, file=sys.stderr)
        return os.EX_CONFIG
    with Issuer(identity, args.connect) as issuer:
        if args.node_key is not None:
            issuer.know_node(args.to, args.node_key)
        code = args.look(issuer, args) if args.compose is None else _order(issuer, args)
        for node, wrong in issuer.complaints().items():
            print(f"{node}: its log contradicts what it signed before: {wrong}", file=sys.stderr)
        for because in issuer.unrecorded():
            print(f"what came of it is missing in the history: {because}", file=sys.stderr)
        return code


def run_history(args: argparse.Namespace) -> int:
    """Print the rows of an identity's own audit; return the exit code."""
    if not (Path(args.identity) / FILE).exists():
        print(f"{args.identity}: nothing was ordered with it here", file=sys.stderr)
        return os.EX_NOINPUT
    try:
        rows = IssuedStore(Path(args.identity)).rows()
    except NotRecorded as error:
        print(error, file=sys.stderr)
        return os.EX_IOERR
    for row in rows:
        print(json.dumps(asdict(row) | {"content": row.content.hex()}) if args.json else _row_words(row))
    return os.EX_OK


def _row_words(row: AuditRow) -> str:
    at = datetime.fromtimestamp(row.at_ms / 1000, UTC).strftime("%Y-%m-%d %H:%M:%S")
    verb = DeviceCommand.FromString(row.content).WhichOneof("command")
    said = row.state if row.state == "unanswered" or not row.result else row.result
    return f"{at} {row.node} {verb} {row.command_id} {said}{f' ({row.detail})' if row.detail else ''}"


def _order(issuer: Issuer, args: argparse.Namespace) -> int:
    if not issuer.knows(args.to) and issuer.wait_status(args.to, lambda _: True, _FOUND_WITHIN_S) is None:
        print(f"{args.to}: no status heard, so its key is not known; give --node-key", file=sys.stderr)
        return os.EX_UNAVAILABLE
    try:
        order = issuer.send(args.to, args.compose(args), args.life)
    except NotRecorded as error:
        print(f"the order was not given: {error}", file=sys.stderr)
        return os.EX_IOERR
    answer = issuer.wait(order, told=_tell)
    pointing = None
    if getattr(args, "until", "") == "arrived" and (answer.state, answer.result) == ("final", "accepted"):
        pointing = issuer.wait_pointing(order, args.camera)
    print(_as_json(order, answer, pointing) if args.json else _as_words(answer, pointing))
    return _exit_code(answer, pointing)


def _tell(answer: Answer) -> None:
    """Say on stderr how far an order got."""
    print(answer.stage or f"not taken on yet: {answer.detail}", file=sys.stderr, flush=True)


def _exit_code(answer: Answer, pointing: Pointing | None) -> int:
    if pointing is not None:
        return os.EX_OK if pointing.state == "arrived" else 1 if pointing.is_done else os.EX_UNAVAILABLE
    if answer.state == "failed":
        return os.EX_CONFIG
    if not answer.result or (answer.state != "final" and answer.result == "accepted"):
        return os.EX_UNAVAILABLE
    return _EXIT.get(answer.result, 1)


def _watch(issuer: Issuer, args: argparse.Namespace) -> int:
    ends_s = time.monotonic() + args.seconds
    newest_ms = 0
    if args.attend:
        issuer.attend(args.to)

    def newer(status: NodeStatus) -> bool:
        return status.at_ms > newest_ms

    try:
        while (left_s := ends_s - time.monotonic()) > 0:
            seen = issuer.wait_status(args.to, newer, min(left_s, 3600))
            if seen is not None:
                newest_ms = seen.status.at_ms
                print(_status_json(seen) if args.json else _status_words(seen), flush=True)
    except KeyboardInterrupt:
        pass
    if not newest_ms:
        print(f"{args.to}: no status heard", file=sys.stderr)
    return os.EX_OK if newest_ms else os.EX_UNAVAILABLE


def _may(issuer: Issuer, args: argparse.Namespace) -> int:
    issuer.wait_status(args.to, lambda _: True, _FOUND_WITHIN_S)
    found = issuer.permissions(args.to)
    if found is None:
        print(f"{args.to}: no status heard", file=sys.stderr)
        return os.EX_UNAVAILABLE
    if args.json:
        print(json.dumps({one.what: {"allowed": one.allowed, "because": one.because} for one in found}))
    else:
        print("\n".join(f"{one.what}: {'yes' if one.allowed else f'no, {one.because}'}" for one in found))
    return os.EX_OK if found[0].allowed else os.EX_NOPERM


def _as_json(order: Order, answer: Answer, pointing: Pointing | None) -> str:
    facts = {name: getattr(answer, name) for name in Answer.__slots__}
    if pointing is not None:
        facts["pointing"] = asdict(pointing) | {"words": pointing.words()}
    return json.dumps({"command_id": order.command_id, "node": order.node, "order_seq": order.order_seq, **facts})


def _as_words(answer: Answer, pointing: Pointing | None) -> str:
    if not answer.result:
        return f"no answer{f': {answer.detail}' if answer.detail else ''}"
    notes = [answer.detail] if answer.detail else []
    notes += ["a repeat of an earlier order"] if answer.duplicate else []
    if answer.state == "pending" and answer.stage:
        return f"{answer.stage}, no last word ({'; '.join(notes)})"
    notes += ["not the last word"] if answer.state == "pending" else []
    notes += [f"the node holds revocation list {answer.revocation_version}"] if answer.result == "unauthorised" else []
    notes += ["the node's clock is uncertain"] if answer.time_quality in (0, 1) else []
    said = answer.result + (f" ({'; '.join(notes)})" if notes else "")
    return said if pointing is None else f"{said}; {pointing.words()}"


def _status_json(seen: SeenStatus) -> str:
    return json.dumps({"node": seen.node, **MessageToDict(seen.status, preserving_proto_field_name=True)})


def _status_words(seen: SeenStatus) -> str:
    status = seen.status
    parts = [f"{seen.node} seq {status.head_seq} {status.health or 'unknown'}", "armed" if status.armed else "disarmed"]
    parts += [words for words in (status.not_recording, status.disk_short) if words]
    for camera in status.cameras:
        held = f" by {camera.callsign}" if camera.callsign else ""
        parts.append(f"camera {camera.camera} {camera.state}{held}{_camera_words(camera)}")
    parts += flight_words(status)
    parts += [f"{poi.class_name}? {poi.mgrs} {poi.decide_within_ms // 1000} s {poi.poi_id}" for poi in status.pois]
    return "; ".join(parts)


def _camera_words(camera: CameraStatus) -> str:
    words = f", asked {camera.asked}" if camera.asked else ""
    if camera.aim in ("arrived", "drifted", "missed"):
        aim = "commanded" if camera.aim == "arrived" and camera.aim_demanded else camera.aim
        words += f", {aim} {camera.error_cdeg / 100:.1f} deg off"
        words += f": {camera.aim_because}" if camera.aim_because else ""
    words += f", zoom {camera.zoom_e4 / 100:.0f} %" if camera.HasField("zoom_e4") else ""
    words += f", gimbal controlled by {camera.gimbal_control}" if camera.gimbal_control else ""
    return words + (f", {camera.caution}" if camera.caution else "")


def _judgement(*, confirmed: bool) -> Compose:
    return lambda args: compose.judge(args.poi, confirmed=confirmed)


def _number(limit: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        value = float(text)
        if not -limit <= value <= limit:
            raise argparse.ArgumentTypeError(f"must be between {-limit:g} and {limit:g}")
        return value

    return number


def _share(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 100:
        raise argparse.ArgumentTypeError("must be between 0 and 100")
    return value


def _life(text: str) -> float:
    life_s = float(text)
    if not 0 < life_s * 1000 <= TTL_MS_MAX:
        raise argparse.ArgumentTypeError(f"must be more than 0 and at most {TTL_MS_MAX // 1000}")
    return life_s


def _key(text: str) -> bytes:
    key = bytes.fromhex(text)
    if len(key) != KEY_BYTES:
        raise argparse.ArgumentTypeError(f"must be {KEY_BYTES} bytes as {2 * KEY_BYTES} hexadecimal digits")
    return key
