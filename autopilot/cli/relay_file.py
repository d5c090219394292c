"""A relay's configuration file: read, judged, and put into a few lines."""

from __future__ import annotations

import tomllib
from pathlib import Path

from autopilot.cli.configuration import load_as
from autopilot.cli.toml_lines import Key
from autopilot.ground.relay_config import RelayConfig, WhoSection

_TLS = ("certificate", "private_key", "authority")
_PATHS: tuple[Key, ...] = (
    *((side, "tls", name) for side in ("outer", "inner") for name in _TLS),
    ("verify", "documents"),
)


def is_relay(path: str | None) -> bool:
    """Say whether a file is a relay's: it has a table [relay], which no node's has."""
    try:
        return path is not None and "relay" in tomllib.loads(Path(path).read_text("utf-8"))
    except (OSError, ValueError):
        return False


def load_relay(path: str, *, inputs: bool = True) -> RelayConfig:
    """Return a relay's configuration. Raises ConfigurationError. `inputs`: the files that it names must exist."""
    return load_as(RelayConfig, path, paths=_PATHS, inputs=_PATHS if inputs else ())


def summary(config: RelayConfig) -> list[str]:
    """Return in a few lines what this relay will do."""
    lines = [f"relay: {config.relay.mode}", f"listens: {', '.join(config.outer.listen)}"]
    lines += [f"{name}: {who.side} of {', '.join(who.nodes)}, {_shown(who)}" for name, who in config.who.items()]
    if config.verify is not None and config.inner is not None:
        owners = config.verify.owners
        known = "all whom the Directory vouches for" if owners is None else ", ".join(owners) or "nobody"
        lines.append(f"inward: {', '.join((*config.inner.connect, *config.inner.listen))}")
        lines.append(f"verified: for {', '.join(config.verify.nodes)}, from {known}")
    return lines


def _shown(who: WhoSection) -> str:
    parts = [f"certificate {' or '.join(who.common_names)}"] if who.common_names else []
    parts += [f"interface {' or '.join(who.interfaces)}"] if who.interfaces else []
    return " and ".join(parts) or "whoever connects"
