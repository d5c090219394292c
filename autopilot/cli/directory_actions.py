"""What `autopilot directory` does: each action gives its facts and its words, and `run` says one of them.

Mistakes are told on stderr with their fix; exit codes are those of sysexits.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from autopilot.ground import directory, enrolment_desk
from autopilot.ground import directory_changes as changes
from autopilot.ground import directory_folders as folders
from autopilot.ground.directory import HOUR_MS, LIFE_HOURS, DirectoryError, open_directory, summary
from autopilot.ground.directory_papers import list_body
from autopilot.ground.directory_store import durable
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.keys import key_id
from autopilot.trust.limits import DOCUMENT_BYTES_MAX


class Said(NamedTuple):
    """What an action did, for a program and for a person."""

    facts: dict[str, Any]
    words: str


Action = Callable[[argparse.Namespace], Said]


def run(action: Action, args: argparse.Namespace) -> int:
    """Do it and say what was done; return the exit code."""
    try:
        said = action(args)
    except DirectoryError as error:
        print(error, file=sys.stderr)
        return os.EX_CANTCREAT if action is init else os.EX_DATAERR
    except enrolment_desk.Refused as error:
        print(f"{args.request}: refused ({error}); {_FIXES[str(error)]}", file=sys.stderr)
        return os.EX_NOPERM
    except OSError as error:
        print(f"{error.filename or args.directory}: {error.strerror}", file=sys.stderr)
        return os.EX_IOERR
    print(json.dumps(said.facts) if args.json else said.words)
    return os.EX_OK


_AGAIN = "make a new code with `autopilot directory enrol`"
_FIXES = {
    "malformed": "it is no request; bring the file that `autopilot enrol --request` wrote",
    "code": f"its code was not given out here, or has run out; {_AGAIN}",
    "mac": f"it was changed on the way; bring it again, or {_AGAIN}",
    "expired": f"its code has run out; {_AGAIN}",
    "used": f"its code was used by another device; find out by which, revoke it, and {_AGAIN}",
    "keys": f"its keys are not the device's own, or in use; remove them there and {_AGAIN}",
    "revoked": f"the principal is revoked; {_AGAIN} for another name",
}


def init(args: argparse.Namespace) -> Said:
    """Make a Directory."""
    deployment_id = args.deployment or f"local-{os.urandom(4).hex()}"
    made = directory.init(
        args.directory,
        deployment_id=deployment_id,
        now_ms=_now_ms(),
        random=os.urandom,
        roots=args.roots,
        threshold=args.threshold,
    )
    root_keys = [key.hex() for key in made.trust.root_keys]
    facts = {"directory": str(made.folder), "deployment_id": deployment_id, "root": root_keys[0]}
    files = ", ".join(directory.root_files(args.roots))
    words = f"{made.folder}: deployment {deployment_id}, root {args.threshold} of {args.roots}; take {files} offline"
    return Said({**facts, "roots": root_keys, "threshold": args.threshold}, words)


def issue(args: argparse.Namespace) -> Said:
    """Issue an identity folder."""
    token = directory.issue(
        open_directory(args.directory, ("epoch", "token")),
        args.principal,
        args.out,
        kind=args.kind,
        roles=args.role,
        callsign=args.callsign,
        now_ms=_now_ms(),
        random=os.urandom,
        hours=args.hours,
    )
    roles = ", ".join(token.roles) or "none"
    words = f"{args.out}: {args.kind} {token.principal_id} ({token.callsign}), roles {roles}"
    return Said({"folder": args.out, **summary(token)}, words)


def enrol(args: argparse.Namespace) -> Said:
    """Give out a code."""
    life_ms = int((LIFE_HOURS[args.kind] if args.hours is None else args.hours) * HOUR_MS)
    code, invitation = enrolment_desk.invite(
        Path(args.directory),
        directory.described(args.principal, args.kind, args.role, args.callsign),
        life_ms,
        _now_ms(),
        int(args.valid * HOUR_MS),
        os.urandom,
    )
    facts = {"principal_id": args.principal, "code": code, "expires_ms": invitation.expires_ms}
    words = f"{code}\nfor {args.principal}, once, within {args.valid:g} h; on the device: autopilot enrol --out FOLDER"
    return Said(facts, words)


def admit(args: argparse.Namespace) -> Said:
    """Answer a request that came as a file."""
    with Path(args.request).open("rb") as file:
        data = file.read(DOCUMENT_BYTES_MAX)
    answer, token = enrolment_desk.admit(Path(args.directory), data, _now_ms(), os.urandom)
    durable(Path(args.out), answer)
    words = f"{args.out}: {token.principal_id} admitted; on the device: autopilot enrol --out FOLDER --response FILE"
    return Said({"answer": args.out, **summary(token)}, words)


def revoke(args: argparse.Namespace) -> Said:
    """Sign the next revocation list."""
    removal = changes.Removal(
        principals=args.principal,
        device_key_ids=args.device,
        token_ids=args.token,
        min_policy_version=args.min_policy,
        min_epoch_id=args.min_epoch,
        even_unknown=args.even_unknown,
        keep_epoch=args.keep_epoch,
    )
    return _changed(changes.revoke(Path(args.directory), removal, _now_ms(), os.urandom))


def rotate(args: argparse.Namespace) -> Said:
    """Begin a new epoch, or replace a purpose key."""
    folder = Path(args.directory)
    if args.purpose is None:
        return _changed(changes.rotate_epoch(folder, _now_ms(), os.urandom, int(args.lead * 1000)))
    return _changed(changes.rotate_purpose(folder, args.purpose, _now_ms(), os.urandom, args.root))


def refresh(args: argparse.Namespace) -> Said:
    """Bring an identity folder up to date; its token too, when half of its life is over."""
    folder = Path(args.directory)
    found = folders.token_in(open_directory(folder, ()), Path(args.folder), _now_ms())
    token = changes.renew(folder, key_id(found.device_sign_pk), _now_ms(), os.urandom)
    folders.write_papers(open_directory(folder, ("epoch", "token")), Path(args.folder), token, _now_ms())
    return _written(args.folder, token)


def export(args: argparse.Namespace) -> Said:
    """Write the newest documents for a device."""
    made = open_directory(args.directory, ("epoch", "token"))
    return _written(args.out, folders.export(made, args.device, Path(args.out), _now_ms()))


def show(args: argparse.Namespace) -> Said:
    """Show who takes part, who is out, and what is in force."""
    found, now_ms = open_directory(args.directory, ()), _now_ms()
    body, live = list_body(found.state), found.live(now_ms)
    facts = {
        "deployment_id": found.trust.deployment_id,
        **changes.in_force(found.folder)._asdict(),
        "root_expires_ms": found.trust.expires_ms,
        "list_due_ms": body.next_update_ms,
        "devices": [{**summary(token), "live": token in live} for token in found.state.tokens],
        "revoked": {
            "principals": list(body.principals),
            "devices": [each.hex() for each in body.device_key_ids],
            "tokens": [each.hex() for each in body.token_ids],
            "min_policy_version": body.min_policy_version,
            "min_epoch_id": body.min_epoch_id,
        },
        "codes": [
            {"principal_id": each.token.principal_id, "expires_ms": each.expires_ms, "used": bool(each.used_by)}
            for each in found.state.invitations
        ],
    }
    return Said(facts, _listed(facts, now_ms))


def serve(args: argparse.Namespace) -> Said:
    """Answer over the mesh until a signal."""
    from autopilot.adapters.mesh.link import Link  # Zenoh: only this action pays for it
    from autopilot.ground.directory_service import Service

    if not args.connect and not args.listen:
        raise DirectoryError("serve: name a router with --connect, or --listen where there is none")
    stops = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, stops)
    link = Link(mode="peer" if args.listen else "client", connect=args.connect, listen=args.listen)
    service = Service(
        Path(args.directory),
        link,
        HostClock(),
        os.urandom,
        rotate_hours=args.rotate_hours,
        say=lambda words: print(words, file=sys.stderr, flush=True),
    )
    service.start()
    signal.sigwait(stops)
    service.stop()
    counts = dict(sorted(service.desk.counts().items()))
    return Said(counts, "\n".join(f"{name} {count}" for name, count in counts.items()) or "nothing was asked")


def _listed(facts: dict[str, Any], now_ms: int) -> str:
    due = "due now" if facts["list_due_ms"] <= now_ms else f"due in {_span(facts['list_due_ms'] - now_ms)}"
    lines = [
        f"{facts['deployment_id']}: root {facts['root_version']}, list {facts['list_version']} ({due}), "
        f"epoch {facts['epoch_id']}"
    ]
    for device in facts["devices"]:
        left_ms = device["not_after_ms"] - now_ms
        state = f"for {_span(left_ms)}" if device["live"] else "replaced, revoked or expired"
        roles = ",".join(device["roles"]) or "-"
        lines.append(f"{device['principal_id']}  {device['kind']}  {roles}  {device['device_key_id']}  {state}")
    revoked = facts["revoked"]
    lines += [f"revoked: {each}" for name in ("principals", "devices", "tokens") for each in revoked[name]]
    lines += [f"code for {each['principal_id']}: {'used' if each['used'] else 'open'}" for each in facts["codes"]]
    return "\n".join(lines)


def _span(span_ms: int) -> str:
    hours = span_ms / HOUR_MS
    return f"{hours / 24:.1f} d" if hours >= 48 else f"{hours:.1f} h"


def _changed(changed: changes.Changed) -> Said:
    words = f"root {changed.root_version}, list {changed.list_version}, epoch {changed.epoch_id}"
    return Said(changed._asdict(), f"in force: {words}; a running `serve` publishes it, files need a refresh")


def _written(folder: str, token: Any) -> Said:
    return Said({"folder": folder, **summary(token)}, f"{folder}: up to date for {token.principal_id}")


def _now_ms() -> int:
    return wall_ms(HostClock())
