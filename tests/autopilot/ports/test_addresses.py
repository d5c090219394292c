"""Addresses of a vehicle as a configuration writes them, and what is said of those that are none."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from autopilot.ports.addresses import Where, parse, parse_listening
from autopilot.ports.config import VehicleSection


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("127.0.0.1:14550", Where("udp", "127.0.0.1", 14550)),
        ("udp://autopilot.local:1", Where("udp", "autopilot.local", 1)),
        ("udp://[::1]:65535", Where("udp", "::1", 65535)),
        ("[::1]:0", Where("udp", "::1", 0)),
        ("tcp://[::1]:5760", Where("tcp", "::1", 5760)),
        ("serial:///dev/ttyAMA0:921600", Where("serial", "/dev/ttyAMA0", 921_600)),
        ("serial:///dev/serial/by-id/usb-a:b-if00:1200", Where("serial", "/dev/serial/by-id/usb-a:b-if00", 1_200)),
    ],
)
def test_what_an_address_names(text: str, where: Where) -> None:
    assert parse(text) == where


NONE = [
    "14550",
    "host:",
    ":14550",
    "127.0.0.1:x",
    "127.0.0.1:99999",
    "127.0.0.1:-1",
    "127.0.0.1:²",
    "127.0.0.1:٣",
    "a/b:1",
]
NONE += ["http://127.0.0.1:80", "tcp://127.0.0.1", "tcp:///dev/x:9", "serial://ttyAMA0:9600", "serial:///dev/x"]
NONE += ["serial:///dev/x:1199", "serial:///dev/x:4000001"]


@pytest.mark.parametrize("text", NONE)
@pytest.mark.parametrize("key", ["connect", "listen"])
def test_what_is_no_address_names_the_key_and_shows_one(key: str, text: str) -> None:
    with pytest.raises(ValueError, match=r"udp://127\.0\.0\.1:14550"):
        parse(text)
    with pytest.raises(ValidationError, match=f"{key} = ") as error:
        VehicleSection.model_validate({key: text})
    assert text in str(error.value)


@pytest.mark.parametrize("text", ["tcp://127.0.0.1:5760", "serial:///dev/ttyAMA0:9600"])
def test_only_datagrams_can_be_waited_for(text: str) -> None:
    with pytest.raises(ValueError, match="use connect"):
        parse_listening(text)
    with pytest.raises(ValidationError, match=r"listen = .*use connect"):
        VehicleSection(listen=text)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"connect": "a:1", "listen": "b:2"}, "listen is given, and connect too"),
        ({"signing": "required"}, "signing_key_file is missing"),
        ({"signing_key_file": "k"}, 'signing_key_file is given, but signing = "off"'),
    ],
)
def test_what_contradicts_itself_is_told(section: dict[str, str], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        VehicleSection.model_validate(section)
