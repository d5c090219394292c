"""What may be configured of a relay: where it listens, who may do what, limits, and what it verifies.

This file only says what may stand in the file and judges it as a whole; what Zenoh is told is `relay_rules`' business.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from autopilot.ports.config import Section
from autopilot.trust.documents import is_name

Hz = Annotated[float, Field(ge=0, le=100_000)]


class RelaySection(Section):
    """Which relay it is."""

    mode: Literal["router", "verifying"] = Field(
        description="router: Zenoh with rules. verifying: two sessions; what passes inward was verified."
    )
    report_s: float = Field(60, ge=0.1, le=86_400, description="The counts are printed this often, and at the end.")


class TlsSection(Section):
    """Certificates of one side (PEM files). They make a link, not an order: no order rests on them."""

    certificate: str = Field(description="This relay's certificate.")
    private_key: str = Field(description="Its private key.")
    authority: str = Field(description="The authority whose certificates are believed on this side.")
    mutual: bool = Field(True, description="True: who connects must show a certificate of that authority.")


class OuterSection(Section):
    """The side that is listened on: in mode router for everybody, in mode verifying for the ground."""

    listen: tuple[str, ...] = Field(min_length=1, description="Endpoints, e.g. tls/0.0.0.0:7447.")
    max_sessions: int = Field(64, ge=1, le=10_000, description="More sessions at a time are refused.")
    max_message_bytes: int = Field(
        266_240, ge=20_480, le=1 << 30, description="What one message may gather to: a full revocation list, and room."
    )
    tls: TlsSection | None = Field(None, description="Absent: endpoints are plain.")


class InnerSection(Section):
    """The side of the nodes, for mode verifying: it connects to a router there, or listens for them."""

    connect: tuple[str, ...] = Field((), description="Endpoints of a router on the nodes' side.")
    listen: tuple[str, ...] = Field((), description="Endpoints where nodes connect.")
    max_sessions: int = Field(64, ge=1, le=10_000, description="More sessions at a time are refused.")
    tls: TlsSection | None = Field(None, description="Absent: endpoints are plain.")

    @model_validator(mode="after")
    def _one_way(self) -> InnerSection:
        """A session is a client or it listens."""
        if bool(self.connect) == bool(self.listen):
            raise ValueError("connect or listen: exactly one of them is needed")
        return self


class RatesSection(Section):
    """What Zenoh lets in of each session and kind of key: one sample in 1/rate seconds, the rest is dropped.

    A limit punishes a link: where a flooder shares it with an operator, orders go down with the flood. 0: no limit.
    """

    orders_hz: Hz = Field(20, description="Orders of one session.")
    cosignatures_hz: Hz = Field(5, description="Cosignatures of one session.")
    presence_hz: Hz = Field(
        20, description="Presence of one session: an operator spreads one a second to each attended node evenly."
    )
    acks_hz: Hz = Field(0, description="Acks of one session; a node answers what it was sent.")
    status_hz: Hz = Field(20, description="Status of one session.")
    proofs_hz: Hz = Field(5, description="Queries for proofs of one session.")
    documents_hz: Hz = Field(5, description="Queries for documents of one session, and each kind that is published.")


class WhoSection(Section):
    """Who may connect, and as what. All that is given must match; nothing given: everybody matches."""

    side: Literal["node", "ground", "directory"] = Field(
        description="node: takes orders. ground: gives them. directory: serves documents to both."
    )
    nodes: tuple[str, ...] = Field(description='Which nodes it is, or may talk to; "*" is all.')
    common_names: tuple[str, ...] = Field((), description="Common names in its certificate, letter by letter.")
    interfaces: tuple[str, ...] = Field((), description="Network interfaces that it comes in by.")

    @model_validator(mode="after")
    def _names(self) -> WhoSection:
        """Zenoh compares letter by letter: a pattern would match nobody, and nobody would know."""
        if not self.nodes or not all(node == "*" or is_name(node) for node in self.nodes):
            raise ValueError('nodes must name nodes ([a-z0-9-], 1 to 64 characters) or be "*"')
        if any(set(name) & set("*?$") for name in self.common_names):
            raise ValueError("common_names are compared letter by letter; a pattern matches nobody")
        return self


class VerifySection(Section):
    """What is verified of each sample, in mode verifying."""

    documents: str = Field(description="Folder with the public trust_root and revocations; a secret there is refused.")
    nodes: tuple[str, ...] = Field(min_length=1, description="Nodes that are relayed; nothing else passes.")
    owners: tuple[str, ...] | None = Field(
        None, description="Principals whose messages pass inward. Absent: all whom the Directory vouches for."
    )
    classification_max: int = Field(0, ge=0, le=255, description="What is classified higher passes neither way.")
    samples_per_s: float = Field(
        10_000, gt=0, le=1e6, description="Judged of one kind of key: about half of a processor of the class it ran on."
    )
    samples_burst: int = Field(2_000, ge=1, le=1_000_000, description="Judged at once.")
    device_per_s: float = Field(50, gt=0, le=100_000, description="Verified samples of one device that pass.")
    device_burst: int = Field(20, ge=1, le=100_000, description="Verified samples of one device that pass at once.")
    queue: int = Field(256, ge=1, le=65_536, description="Verified samples that wait for the other side, each way.")

    @model_validator(mode="after")
    def _names(self) -> VerifySection:
        """A node is one chunk of a key."""
        if not all(map(is_name, self.nodes)):
            raise ValueError("nodes must name nodes ([a-z0-9-], 1 to 64 characters)")
        return self


class RelayConfig(Section):
    """The whole configuration of a relay."""

    schema_version: Literal[1] = Field(1, description="Version of this file's form.")
    relay: RelaySection
    outer: OuterSection
    inner: InnerSection | None = None
    rates: RatesSection = RatesSection()
    who: dict[str, WhoSection] = Field(description="Who may connect; whoever matches nothing may do nothing.")
    verify: VerifySection | None = None

    @model_validator(mode="after")
    def _whole(self) -> RelayConfig:
        """Each mode has its sections, and TLS stands where it is listened by it."""
        verifying = self.relay.mode == "verifying"
        if not all(map(is_name, self.who)):
            raise ValueError("who has a name that is none: [a-z0-9-], 1 to 64 characters")
        for name in ("inner", "verify"):
            if verifying != (getattr(self, name) is not None):
                raise ValueError(f"{name} {'is needed' if verifying else 'has no meaning'} in mode {self.relay.mode}")
        for name, side in (("outer", self.outer), ("inner", self.inner)):
            ends = () if side is None else (*side.listen, *getattr(side, "connect", ()))
            if side is not None and any(end.startswith("tls/") for end in ends) != (side.tls is not None):
                raise ValueError(f"{name} needs tls with endpoints that begin with tls/, and only with them")
        outside_tls = self.outer.tls is None or not self.outer.tls.mutual
        if not verifying and outside_tls and any(who.common_names for who in self.who.values()):
            raise ValueError("who has common_names, but nobody shows a certificate without outer.tls and mutual = true")
        return self
