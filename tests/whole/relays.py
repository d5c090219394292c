"""Relays as processes of their own, sessions beside them, and certificates; nothing here checks anything."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from autopilot.adapters.mesh.link import session_config
from tests.whole.daemons import WITHIN_S, wait_for

COMMAND = [sys.executable, "-m", "autopilot.cli.main", "relay", "--config"]


def free_port() -> int:
    """Return a TCP port of loopback that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
        return port


def free_datagram_port() -> int:
    """Return a UDP port of loopback that is free now."""
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


def plain() -> str:
    """Return a free endpoint without TLS."""
    return f"tcp/127.0.0.1:{free_port()}"


def write_relay(folder: Path, tables: Mapping[str, Any]) -> Path:
    """Write a relay's configuration from nested tables; return its path."""
    lines = ["schema_version = 1"]

    def write(name: str, table: Mapping[str, Any]) -> None:
        inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
        lines.append(f"[{name}]")
        lines.extend(f"{key} = {json.dumps(value)}" for key, value in table.items() if key not in inner)
        for key, value in inner.items():
            write(f"{name}.{key}", value)

    for name, table in tables.items():
        write(name, table)
    path = folder / "relay.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def who_may_pass() -> dict[str, Any]:
    """Return the configuration of a router that knows nodes, ground and Directory, and nobody else."""
    sides = ("node", "ground", "directory")
    return {
        "relay": {"mode": "router"},
        "rates": {"orders_hz": 0, "documents_hz": 0},
        "who": {side: {"side": side, "nodes": ["*"]} for side in sides},
    }


class RelayProcess:
    """A relay that is ready."""

    def __init__(self, config: Path) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, str(config)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        line = self.process.stderr.readline()
        if "ready" not in line:
            raise RuntimeError(line + self.process.stderr.read())

    def counts(self) -> dict[str, dict[str, int]]:
        """End it; return the counts that it printed last."""
        self.process.terminate()
        out, _ = self.process.communicate(timeout=WITHIN_S)
        found: dict[str, dict[str, int]] = json.loads(out.splitlines()[-1])
        return found


@contextmanager
def relaying(folder: Path, tables: Mapping[str, Any]) -> Iterator[RelayProcess]:
    """Run a relay; kill it at the end where it still runs."""
    relay = RelayProcess(write_relay(folder, tables))
    try:
        yield relay
    finally:
        relay.process.kill()
        relay.process.communicate()


@dataclass
class Ears:
    """What one subscription heard."""

    keys: list[str] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def take(self, sample: zenoh.Sample) -> None:
        """Remember a sample."""
        with self.changed:
            self.keys.append(str(sample.key_expr))
            self.payloads.append(sample.payload.to_bytes())
            self.changed.notify_all()

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition on what was heard holds. Raises TimeoutError."""
        with self.changed:
            if not self.changed.wait_for(condition, WITHIN_S):
                raise TimeoutError(f"heard only {self.keys}")


@contextmanager
def session(endpoint: str, mode: Any = "client", **over: Any) -> Iterator[zenoh.Session]:
    """Open a session of somebody else, with our settings; it must find its router at once."""
    opened = zenoh.open(session_config(mode, connect=[endpoint], over=over))
    try:
        wait_for(lambda: bool(opened.info.routers_zid()), "a router")
        yield opened
    finally:
        opened.close()  # type: ignore[no-untyped-call]


def listen(opened: zenoh.Session, key_expr: str) -> tuple[Ears, object]:
    """Subscribe; hold on to the second part for as long as it is to hear."""
    ears = Ears()
    return ears, opened.declare_subscriber(key_expr, ears.take)


def put(opened: zenoh.Session, key_expr: str, payload: bytes = b"x" * 300) -> None:
    """Publish so that nothing is lost for want of room."""
    opened.put(key_expr, payload, congestion_control=zenoh.CongestionControl.BLOCK)


def authority(folder: Path, *names: str) -> dict[str, dict[str, str]]:
    """Make an authority and a certificate for each name, good for 127.0.0.1; return their files by name."""
    folder.mkdir(parents=True, exist_ok=True)
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    _openssl(folder, "req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.crt", "-subj", "/CN=ca", "-days", "2")
    (folder / "names").write_text("subjectAltName=IP:127.0.0.1,DNS:localhost\n", encoding="utf-8")
    for number, name in enumerate(names):
        stem = f"c{number}"
        _openssl(folder, "req", *key, "-keyout", f"{stem}.key", "-out", f"{stem}.csr", "-subj", f"/CN={name}")
        signs = ["-CA", "ca.crt", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-extfile", "names"]
        _openssl(folder, "x509", "-req", "-in", f"{stem}.csr", "-out", f"{stem}.crt", *signs)
    return {
        name: {
            "certificate": str(folder / f"c{number}.crt"),
            "private_key": str(folder / f"c{number}.key"),
            "authority": str(folder / "ca.crt"),
        }
        for number, name in enumerate(names)
    }


def shown(port: int, papers: Mapping[str, str]) -> str:
    """Return the endpoint of somebody who shows a certificate: all that a node or operator has to write."""
    parts = {
        "root_ca_certificate_file": papers["authority"],
        "connect_certificate_file": papers["certificate"],
        "connect_private_key_file": papers["private_key"],
        "enable_mtls": "true",
    }
    return f"tls/127.0.0.1:{port}#" + ";".join(f"{name}={value}" for name, value in parts.items())


def _openssl(folder: Path, *words: str) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)
