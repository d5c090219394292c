"""The stage of the demo: a router, an aircraft with its world, and the daemon, each a process of its own on loopback.

Each can be stopped, killed and started again by itself; the ports stay the same. Tests stand on this stage too.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Self

from autopilot.cli.demonstration.cast import NODE, Cast, make_cast

PATIENCE_S = 20.0

_CONFIG = """\
# Written by the demo. Every key is explained by `autopilot check --schema`.
schema_version = 1

[node]
keys = "keys"
flights = "flights"
projections = "projections.db"

[command]
enabled = true
camera_roles = ["operator", "admin"]
operator_hold_s = {hold_s}

[mesh]
mode = "client"
connect = ["tcp/127.0.0.1:{mesh}"]
reconnect_ms = 250

[vehicle]
connect = "127.0.0.1:{mavlink}"
gimbal_measures = true

[eyes]
source = "external"
endpoint = "127.0.0.1:{eyes}"

[scan]
enabled = true
look_s = 2.0

[find]
sightings_to_ask = 4
"""


class ProcessFailed(RuntimeError):
    """A process of the stage did not come up, or ended when it should not have."""


class Process:
    """A child process that can be started again. Its words go to a file."""

    def __init__(self, name: str, command: Sequence[str], log: Path, ready: str = "") -> None:
        self.name = name
        self._command = command
        self._log = log
        self._ready = ready
        self._child: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start it and wait for its word that it is ready. Raises ProcessFailed."""
        with self._log.open("a") as log:
            out: IO[str] | int = subprocess.PIPE if self._ready else log
            self._child = subprocess.Popen(self._command, stdin=subprocess.DEVNULL, stdout=out, stderr=log, text=True)
        if self._ready and self._child.stdout is not None:
            with self._child.stdout as words:
                if self._ready not in words.readline():
                    raise ProcessFailed(f"the {self.name} did not come up; see {self._log}")

    def stop(self) -> int:
        """Ask it to end and wait; return its exit code."""
        return self._end(signal.SIGTERM)

    def kill(self) -> int:
        """Take its life, as a power cut does, and wait; return its exit code."""
        return self._end(signal.SIGKILL)

    def pause(self) -> None:
        """Let it stand still, as a radio link does: its connections stay, nothing passes."""
        self._signal(signal.SIGSTOP)

    def resume(self) -> None:
        """Let it go on."""
        self._signal(signal.SIGCONT)

    @property
    def pid(self) -> int:
        """Its process id. Raises ProcessFailed before it was started."""
        if self._child is None:
            raise ProcessFailed(f"the {self.name} was not started")
        return self._child.pid

    @property
    def running(self) -> bool:
        """Whether it is there."""
        return self._child is not None and self._child.poll() is None

    def _signal(self, number: signal.Signals) -> None:
        if self._child is not None and self._child.poll() is None:
            self._child.send_signal(number)

    def _end(self, number: signal.Signals) -> int:
        if self._child is None:
            return 0
        self._signal(signal.SIGCONT)
        self._signal(number)
        try:
            return self._child.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
            raise ProcessFailed(f"the {self.name} did not end within {PATIENCE_S:.0f} s; see {self._log}") from None


@dataclass(frozen=True, slots=True)
class Ports:
    """Free ports of loopback."""

    mesh: int
    mavlink: int
    eyes: int
    office: int
    door: int


class Stage:
    """Folder, cast and processes of one demo."""

    def __init__(
        self,
        folder: Path,
        seconds: float,
        seed: int,
        *,
        hold_s: float = 8.0,
        flown_by: Sequence[str] = (),
        door: bool = False,
    ) -> None:
        """Make everything that lies in files; `flown_by` are further arguments of the aircraft's process.

        Raises DirectoryError and OSError.
        """
        self.folder = folder
        self.ports = _free_ports()
        self.endpoint = f"tcp/127.0.0.1:{self.ports.mesh}"
        self.cast: Cast = make_cast(folder)
        self.config = folder / "node" / "config.toml"
        ports = {"mesh": self.ports.mesh, "mavlink": self.ports.mavlink, "eyes": self.ports.eyes}
        self.config.write_text(_CONFIG.format(hold_s=hold_s, **ports))
        logs = folder / "logs"
        logs.mkdir(exist_ok=True)
        python = sys.executable
        router = [python, "-m", "autopilot.sim.router", "--listen", self.endpoint]
        world = [python, "-m", "autopilot.sim.process", "--seed", str(seed), "--seconds", str(seconds), "--hold"]
        world += ["--mavlink-port", str(self.ports.mavlink), "--eyes-port", str(self.ports.eyes), *flown_by]
        world += ["--door-port", str(self.ports.door)] if door else []
        node = [python, "-m", "autopilot.cli.main", "run", "--config", str(self.config)]
        self.router = Process("router", router, logs / "router.log", ready="ready")
        self.world = Process("aircraft", world, logs / "aircraft.log", ready="ready")
        self.node = Process("node", node, logs / "node.log")

    def __enter__(self) -> Self:
        """Start everything. Raises ProcessFailed."""
        try:
            for process in self.processes:
                process.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        with ExitStack() as stack:  # one that does not end must not leave the others running
            for process in self.processes:
                stack.callback(process.stop)

    @property
    def processes(self) -> tuple[Process, ...]:
        """All processes in the order in which they start."""
        return self.router, self.world, self.node

    @property
    def flight(self) -> Path:
        """Folder of the newest flight. Raises ProcessFailed before there is one."""
        flights = sorted((self.folder / "node" / "flights").glob("[0-9]*-*"))
        if not flights:
            raise ProcessFailed(f"{NODE} opened no flight; see {self.folder / 'logs' / 'node.log'}")
        return flights[-1]


def _free_ports() -> Ports:
    """Return ports that were free a moment ago. All are held together, so that they differ."""
    kinds = {"mavlink": socket.SOCK_DGRAM}
    with ExitStack() as stack:
        held = {name: socket.socket(socket.AF_INET, kinds.get(name, socket.SOCK_STREAM)) for name in Ports.__slots__}
        for one in held.values():
            stack.enter_context(one).bind(("127.0.0.1", 0))
        return Ports(**{name: one.getsockname()[1] for name, one in held.items()})
