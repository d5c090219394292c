"""A relay's file: what is said of a wrong one, what Zenoh is told, which documents are taken."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.mesh.link import session_config
from autopilot.cli import check as check_command
from autopilot.cli import relay as relay_command
from autopilot.cli.configuration import ConfigurationError
from autopilot.cli.relay_file import is_relay, load_relay, summary
from autopilot.ground.relay_config import RelayConfig, WhoSection
from autopilot.ground.relay_papers import Papers, PapersError
from autopilot.ground.relay_rules import access, downsampling, inner_settings, low_pass, outer_settings
from autopilot.trust import pae
from autopilot.trust.documents import sign
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
from autopilot.wire.keys import CHANNELS, DIRECTORY_CHANNELS, NODE_CHANNELS
from events.schema.waypoint_pb2 import RevocationList
from tests.autopilot.trust.world import NOW_MS, people

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "relay.toml"
ROUTER = (
    '[relay]\nmode = "router"\n[outer]\nlisten = ["tcp/127.0.0.1:7447"]\n[who.all]\nside = "ground"\nnodes = ["n"]\n'
)
VERIFYING = (
    '[relay]\nmode = "verifying"\n[outer]\nlisten = ["tcp/127.0.0.1:1"]\n[inner]\nconnect = ["tcp/127.0.0.1:2"]\n'
    '[who.all]\nside = "ground"\nnodes = ["n"]\n[verify]\ndocuments = "public"\nnodes = ["n"]\n'
)
YEAR_MS = 365 * 86_400_000


def load(folder: Path, text: str) -> RelayConfig:
    """Load a text as a file, whose inputs may be absent."""
    file = folder / "relay.toml"
    file.write_text(text, encoding="utf-8")
    return load_relay(str(file), inputs=False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (ROUTER + "[rate]", '8 | rate | is not a key of the configuration; did you mean "rates"?'),
        (ROUTER + "[rates]\norders = 3", "9 | rates.orders | is not a key of the configuration"),
        (ROUTER + "node = 1", '8 | who.all.node | is not a key of the configuration; did you mean "nodes"?'),
        (ROUTER + "samples_per_s = 1", "8 | who.all.samples_per_s | is not a key of the configuration; it belongs to"),
        (ROUTER + 'common_names = ["al*"]', "8 | who.all.common_names | common_names are compared letter by letter"),
        (ROUTER + 'common_names = ["al"]', "5 | who | who has common_names, but nobody shows a certificate"),
        (ROUTER.replace('["n"]', '["wasp/01"]'), "7 | who.all.nodes | nodes must name nodes"),
        (ROUTER.replace('["n"]', "[]"), "7 | who.all.nodes | nodes must name nodes"),
        (ROUTER.replace("who.all", 'who."a:b"'), "5 | who | who has a name that is none"),
        (ROUTER.replace("router", "verifying"), "0 | inner | inner is needed in mode verifying"),
        (VERIFYING.replace("verifying", "router"), "5 | inner | inner has no meaning in mode router"),
        (ROUTER + '[verify]\ndocuments = "."\nnodes = ["n"]', "8 | verify | verify has no meaning in mode router"),
        (ROUTER.replace("tcp/", "tls/"), "3 | outer | outer needs tls with endpoints that begin with tls/"),
        (VERIFYING.replace('"public"\nnodes = ["n"]', '"p"\nnodes = ["*"]'),
         "12 | verify.nodes | nodes must name nodes"),
        (VERIFYING.replace('connect = ["tcp/127.0.0.1:2"]', ""), "5 | inner.connect | connect or listen"),
        (ROUTER.replace('listen = ["tcp/127.0.0.1:7447"]', "listen = []"), "4 | outer.listen | "),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        load(tmp_path, text)
    found = [f"{problem.line} | {problem.key} | {problem.reason}" for problem in error.value.problems]
    assert [line.startswith(expected) for line in found] == [True], found


def test_paths_start_at_the_file_and_must_exist(tmp_path: Path) -> None:
    config = load(tmp_path, VERIFYING)
    assert config.verify is not None
    assert config.verify.documents == str(tmp_path / "public")
    with pytest.raises(ConfigurationError, match=r"relay.toml:11: verify.documents: there is no .*public"):
        load_relay(str(tmp_path / "relay.toml"))
    (tmp_path / "public").mkdir()
    assert load_relay(str(tmp_path / "relay.toml")) == config


def test_the_example_is_good_and_check_knows_a_relay(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    args = argparse.Namespace(config=str(EXAMPLE), elsewhere=True, json=False, schema=False)
    assert check_command.run(args) == 0
    assert "verified: for wasp-01, hornet-02, from all whom" in capsys.readouterr().out
    args.elsewhere = False
    assert check_command.run(args) == 78
    assert "there is no /etc/autopilot/relay.crt" in capsys.readouterr().err
    drone = EXAMPLE.with_name("drone.toml")
    assert [is_relay(path) for path in (str(EXAMPLE), str(drone), str(tmp_path), None)] == [True, False, False, False]


def test_a_summary_says_who_may_do_what(tmp_path: Path) -> None:
    text = VERIFYING + 'owners = []\n[who.cert]\nside = "node"\nnodes = ["n"]\ninterfaces = ["lo", "wg0"]\n'
    assert summary(load(tmp_path, text)) == [
        "relay: verifying",
        "listens: tcp/127.0.0.1:1",
        "all: ground of n, whoever connects",
        "cert: node of n, interface lo or wg0",
        "inward: tcp/127.0.0.1:2",
        "verified: for n, from nobody",
    ]


def test_show_prints_what_zenoh_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """And Zenoh takes it, path by path."""
    assert relay_command.run(argparse.Namespace(config=str(EXAMPLE), show=True)) == 0
    shown = json.loads(capsys.readouterr().out)
    for settings in shown.values():
        told = json.loads(str(session_config("router", listen=["tcp/127.0.0.1:0"], over=settings)))
        assert told["access_control"]["enabled"] is True
        assert told["access_control"]["default_permission"] == "deny"
        assert told["scouting"]["gossip"]["enabled"] is told["scouting"]["multicast"]["enabled"] is False
        assert told["transport"]["shared_memory"]["enabled"] is False
        assert told["transport"]["unicast"]["compression"]["enabled"] is False
        assert told["adminspace"]["enabled"] is told["plugins_loading"]["enabled"] is False
    for settings in shown.values():
        assert settings["transport/unicast/max_sessions"] == 64
        assert settings["transport/unicast/accept_timeout"] == 3000  # Zenoh's own is 10 s
        assert settings["transport/unicast/accept_pending"] == 256
    assert shown["outer"]["transport/link/rx/max_message_size"] == 266_240
    assert shown["outer"]["transport/link/protocols"] == ["tls"]
    assert shown["inner"]["transport/link/protocols"] == ["tcp"]


def test_an_inner_side_that_connects_has_nobody_to_bind(tmp_path: Path) -> None:
    """It is a client with or without a certificate; the router that it connects to has rules of its own."""
    config = load(tmp_path, VERIFYING)
    assert inner_settings(config) == {"transport/link/protocols": ["tcp"]}
    tls = '[inner.tls]\ncertificate = "c"\nprivate_key = "k"\nauthority = "a"\n'
    with_tls = inner_settings(load(tmp_path, VERIFYING.replace("tcp/127.0.0.1:2", "tls/127.0.0.1:2") + tls))
    assert with_tls["transport/link/tls/connect_certificate"] == str(tmp_path / "c")
    assert "transport/link/tls/listen_certificate" not in with_tls


def test_each_side_of_a_verifying_relay_binds_its_own(tmp_path: Path) -> None:
    """Nodes have no rule outside, the ground none inside: nothing passes but through the relay's own hands."""
    text = VERIFYING.replace("connect =", "listen =") + '[who.node]\nside = "node"\nnodes = ["n"]\n'
    config = load(tmp_path, text)
    sides: list[Any] = [outer_settings(config)["access_control"], inner_settings(config)["access_control"]]
    assert [[subject["id"] for subject in side["subjects"]] for side in sides] == [["all"], ["node"]]


def rules_of(side: str) -> list[tuple[str, str, str]]:
    """Return the rules of one side as (flow, message, key)."""
    made: Any = access({"x": WhoSection.model_validate({"side": side, "nodes": ("n",)})})
    return sorted((*rule["flows"], *rule["messages"], *rule["key_exprs"]) for rule in made["rules"])


def of_nodes(rules: list[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Return the rules that are about nodes, not about a Directory's documents."""
    return [rule for rule in rules if not rule[2].startswith(("waypoint/global/trust/", "waypoint/global/enrol"))]


def test_documents_come_from_the_directory_alone() -> None:
    """It answers and publishes, nodes and ground ask and hear; of orders and answers it has no part."""
    turned = {"ingress": "egress", "egress": "ingress"}
    served = rules_of("directory")
    assert of_nodes(served) == []
    for side in ("node", "ground"):
        asked = [rule for rule in rules_of(side) if rule not in of_nodes(rules_of(side))]
        assert sorted((turned[flow], message, key) for flow, message, key in served) == asked
    assert ("ingress", "put", "waypoint/global/trust/*/revocations") in served
    assert ("ingress", "query", "waypoint/global/enrol") in rules_of("node")
    assert len(served) == 5 * len(DIRECTORY_CHANNELS)


def test_the_two_sides_are_each_others_mirror() -> None:
    """What one may say the other may hear, and nothing may be said by both."""
    turned = {"ingress": "egress", "egress": "ingress"}
    ground, node = of_nodes(rules_of("ground")), of_nodes(rules_of("node"))
    assert sorted((turned[flow], message, key) for flow, message, key in node) == ground
    assert set(ground) & set(node) == set()
    assert len(ground) == 2 * len(NODE_CHANNELS) + 1


def test_the_ground_gives_orders_and_hears_answers() -> None:
    assert of_nodes(rules_of("ground")) == sorted(
        [
            ("ingress", "put", "waypoint/global/cmd/n/*"),
            ("egress", "declare_subscriber", "waypoint/global/cmd/n/**"),
            ("ingress", "put", "waypoint/global/cosign/n"),
            ("egress", "declare_subscriber", "waypoint/global/cosign/n"),
            ("ingress", "put", "waypoint/global/heartbeat/n/*"),
            ("egress", "declare_subscriber", "waypoint/global/heartbeat/n/*"),
            ("egress", "put", "waypoint/global/ack/n/*"),
            ("ingress", "declare_subscriber", "waypoint/global/ack/n/**"),
            ("egress", "put", "waypoint/global/status/n"),
            ("ingress", "declare_subscriber", "waypoint/global/status/n"),
            ("ingress", "query", "waypoint/global/proof/n"),
            ("egress", "reply", "waypoint/global/proof/n"),
            ("egress", "declare_queryable", "waypoint/global/proof/n"),
        ]
    )


def test_every_channel_is_limited_in_size_and_rate(tmp_path: Path) -> None:
    """A channel that is added has to have both."""
    rates = load(tmp_path, ROUTER + "[rates]\nacks_hz = 1").rates
    assert {str(one["id"]) for one in downsampling(rates)} == {f"rate:{channel.name}" for channel in CHANNELS}
    assert {str(one["id"]) for one in low_pass()} == {f"size:{channel.name}" for channel in CHANNELS}
    assert [one["id"] for one in downsampling(load(tmp_path, ROUTER).rates) if one["id"] == "rate:acks"] == []


def public(folder: Path, version: int = 1, principals: tuple[str, ...] = ()) -> Path:
    """Write the trust root and a list of this version."""
    made = people().directory
    folder.mkdir(exist_ok=True)
    (folder / ROOT_FILE).write_bytes((made.folder / ROOT_FILE).read_bytes())
    listed = RevocationList(
        v=1, deployment_id="coast-watch", version=version, issued_at_ms=NOW_MS, next_update_ms=NOW_MS + 1,
        prev_digest=b"p" * 32, principals=principals, min_policy_version=1, min_epoch_id=1,
    )  # fmt: skip
    signed = sign(pae.REVOCATION_LIST, listed, [made.purpose_keys["revoke"]])
    (folder / REVOCATIONS_FILE).write_bytes(signed)
    return folder


def test_a_newer_list_is_taken_and_an_older_or_other_one_is_not(tmp_path: Path) -> None:
    papers = Papers(public(tmp_path / "p", 3), NOW_MS)
    assert (papers.look(), papers.revocations().version) == ("", 3)
    public(tmp_path / "p", 4, ("alice",))
    assert (papers.look(), papers.revocations().principals) == ("", frozenset({"alice"}))
    for version, words in ((3, "version 3 is older than 4"), (4, "another list of version 4")):
        public(tmp_path / "p", version)
        assert words in papers.look()
        assert papers.revocations().principals == frozenset({"alice"})
    (tmp_path / "p" / REVOCATIONS_FILE).write_bytes(b"x")
    assert "revocations" in papers.look()
    (tmp_path / "p" / REVOCATIONS_FILE).unlink()
    assert "No such file" in papers.look()
    assert papers.revocations().version == 4


@pytest.mark.parametrize("secret", ["device.sign", "device.box", "epoch"])
def test_a_folder_with_a_secret_is_refused(tmp_path: Path, secret: str) -> None:
    """Whoever points it at an identity's folder is told, and nothing is read from it."""
    folder = public(tmp_path / "p")
    (folder / secret).write_bytes(b"s" * 32)
    with pytest.raises(PapersError, match=f"{secret}: a relay holds no secrets"):
        Papers(folder, NOW_MS)


def test_documents_that_do_not_hold_are_refused(tmp_path: Path) -> None:
    folder = public(tmp_path / "p")
    with pytest.raises(PapersError, match="trust_root: has expired"):
        Papers(folder, NOW_MS + YEAR_MS)
    (folder / ROOT_FILE).write_bytes(b"x")
    with pytest.raises(PapersError, match=r"trust_root: .*copy the Directory's trust root"):
        Papers(folder, NOW_MS)
    (folder / ROOT_FILE).unlink()
    with pytest.raises(PapersError, match="trust_root: No such file"):
        Papers(folder, NOW_MS)
    public(folder)
    (folder / REVOCATIONS_FILE).write_bytes(b"x")
    with pytest.raises(PapersError, match=r"revocations: .*newest list"):
        Papers(folder, NOW_MS)
