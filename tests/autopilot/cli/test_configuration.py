"""Configurations and what is said of them: lines, keys, reasons, suggestions; files, merging, paths; the manifest."""

import argparse
import json
from pathlib import Path
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.cli import check
from autopilot.cli.configuration import ConfigurationError, load
from autopilot.cli.toml_lines import lines_of
from autopilot.node.limits import configuration_message
from autopilot.ports.config import Config

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
NODE = '[node]\nkeys = "keys"\nflights = "flights"\nprojections = "p.db"\n'
MISSION = '[vehicle]\nlisten = "127.0.0.1:1"\n[mission]\nenabled = true\nurl = "http://office"\n'
MISSION += f'mission_id = "{UUID(int=7)}"\n'
SCAN = "enabled, look_s, sweep_pitch_deg, frame_rate_floor"


def check_problems(folder: Path, text: str, expected: str) -> None:
    """Say what is wrong with [node] and the text after it (which begins on line 5): "line | key | reason" a line."""
    file = folder / "c.toml"
    file.write_text(NODE + text)
    with pytest.raises(ConfigurationError) as error:
        load(str(file), {})
    found = [f"{problem.line} | {problem.key} | {problem.reason}" for problem in error.value.problems]
    assert found == [line.strip() for line in expected.strip().splitlines()]
    assert {problem.file for problem in error.value.problems} == {str(file)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[comand]", '5 | comand | is not a key of the configuration; did you mean "command"?'),
        (
            "[eyes]\nconfidense = 0.4",
            '6 | eyes.confidense | is not a key of the configuration; did you mean "confidence"?',
        ),
        (
            "[eyes.pose]\nlatitude_deg = 1\nlongitude_deg = 1\nheight_m = 3\npitch_deg = 0\nyaw = 3",
            '10 | eyes.pose.yaw | is not a key of the configuration; did you mean "yaw_deg"?',
        ),
        ("[find]\nlook_s = 4", "6 | find.look_s | is not a key of the configuration; it belongs to [scan]"),
        (
            "[scan]\nq = 1",
            f"6 | scan.q | is not a key of the configuration; known here: {SCAN}",
        ),
        ("[command]\nenabled = 1", "6 | command.enabled | must be a valid boolean, not 1"),
        ('[eyes]\nconfidence = "0.4"', '6 | eyes.confidence | must be a valid number, not "0.4"'),
        ("[eyes]\n\n# so\nconfidence = 1.4", "8 | eyes.confidence | must be less than or equal to 1, not 1.4"),
        ("[eyes]\nconfidence = nan", "6 | eyes.confidence | must be a finite number, not NaN"),
        ("[limits]\ncommit_stall_s = inf", "6 | limits.commit_stall_s | must be a finite number, not Infinity"),
        ('[mesh]\nmode = "pear"', "6 | mesh.mode | must be 'client' or 'peer', not \"pear\""),
        ("[eyes]\nmodel = 1979-05-27\nthreads = 1.5", "7 | eyes.threads | must be a valid integer, not 1.5"),
        ('[command]\ncamera_roles = [\n  "a",\n  2,\n]', "6 | command.camera_roles | must be a valid string, not 2"),
        (
            "mesh = 3",
            "5 | node.mesh | is not a key of the configuration; known here: keys, flights, projections, documents",
        ),
        ('[eyes]\nsource = "file"', '6 | eyes.source | source = "file" needs path and model'),
        (
            "[flight]\norigin = [8.5, 47.4]",
            "6 | flight.origin | has too few values",
        ),
        (
            "[flight]\norigin = [95, 8.5, 400]",
            "6 | flight.origin | origin is latitude (+-90), longitude (+-180), altitude in metres, in this order",
        ),
        (
            '[eyes]\nsource = "external"\nendpoint = "localhost"',
            '7 | eyes.endpoint | endpoint is host:port, such as 127.0.0.1:7600, not "localhost"',
        ),
        ('[eyes]\nendpoint = "a:0"', '6 | eyes.endpoint | endpoint is host:port, such as 127.0.0.1:7600, not "a:0"'),
        ("[find]\ndecide_shortest_s = 200", "6 | find.decide_shortest_s | decide_shortest_s is above decide_longest_s"),
        ('[find.groups]\na = ["dog"]\nb = ["dog", "cow"]', "5 | find.groups | groups has dog more than once"),
        (
            "[safety]\nbattery_land_percent = 25",
            "6 | safety.battery_land_percent | battery_land_percent is not below battery_return_percent",
        ),
        (
            "[safety]\noperator_lost_s = 5",
            "5 | safety.operator_degraded_s | operator_degraded_s is not below operator_lost_s",
        ),
        (
            "[flight]\nenabled = true\n[safety]\nfence_ahead_s = 0.69",
            "8 | safety.fence_ahead_s | safety.fence_ahead_s is below 0.7: places are told vehicle.position_period_s"
            " apart, and the vehicle says them every 0.2 s",
        ),
        (
            "[flight]\nenabled = true\n[mesh]\npresence_period_s = 2.51",
            "8 | mesh.presence_period_s | mesh.presence_period_s is above 2.5: operators who are there would be taken"
            " for gone; it goes twice into safety.operator_degraded_s",
        ),
        ('[vehicle]\nsigning = "required"\nsigning_key_file = "/no/k"', "7 | vehicle.signing_key_file | no file /no/k"),
        (
            '[mission]\nenabled = true\nfile = "m.json"',
            "6 | mission.enabled | mission.enabled = true needs a [vehicle] with listen or connect: who flies it?",
        ),
        ("[eyes.pose]\nlatitude_deg = 1\nlongitude_deg = 2\npitch_deg = 3", "5 | eyes.pose.height_m | is missing"),
        (
            '[eyes]\nsource = "file"\npath = "/no/v.avi"\nmodel = "/no/m.onnx"',
            "7 | eyes.path | no file /no/v.avi\n8 | eyes.model | no file /no/m.onnx",
        ),
        (
            "[scan]\nlook_s = -1\nspeed = 2\n[vehicle]\nattempts = 99",
            f"""6 | scan.look_s | must be greater than 0, not -1
                7 | scan.speed | is not a key of the configuration; known here: {SCAN}
                9 | vehicle.attempts | must be less than or equal to 10, not 99""",
        ),
        ("[eyes\nthreads = 1", "5 |  | is no TOML: Expected ']' at the end of a table declaration"),
        ("a = 1\na = 2", "6 |  | is no TOML: Cannot overwrite a value"),
        ("[a]\nb = [1,\n\n", "6 |  | is no TOML: Invalid value"),
    ],
)
def test_every_mistake_has_its_line(tmp_path: Path, text: str, expected: str) -> None:
    """The line, the dotted key, the reason, and what was probably meant."""
    check_problems(tmp_path, text, expected)


def test_a_missing_table_is_told_at_the_file(tmp_path: Path) -> None:
    """Nothing is there that a line could point at."""
    file = tmp_path / "c.toml"
    file.write_text("schema_version = 1\n")
    with pytest.raises(ConfigurationError) as error:
        load(str(file), {})
    assert str(error.value) == f"{file}: node: is missing"
    assert error.value.exit_code == 78


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    """Absent, a folder, not UTF-8."""
    bad = tmp_path / "bad.toml"
    bad.write_bytes(b"# fine\n# \xff\n")
    for path, words in (
        (tmp_path / "none.toml", "there is no such file; name one with --config FILE or AUTOPILOT_CONFIG"),
        (tmp_path, "cannot be read: Is a directory"),
        (bad, "is not UTF-8 here"),
    ):
        with pytest.raises(ConfigurationError) as error:
            load(str(path), {})
        assert [problem.reason for problem in error.value.problems] == [words]
    assert str(error.value).startswith(f"{bad}:2: ")


def test_which_file_is_read(tmp_path: Path) -> None:
    """The flag comes before the environment, the environment before the usual place."""
    for name in ("flag", "env"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "c.toml").write_text(NODE)
    flag, env = str(tmp_path / "flag/c.toml"), {"AUTOPILOT_CONFIG": str(tmp_path / "env/c.toml")}
    assert load(flag, env).node.keys == str(tmp_path / "flag/keys")
    assert load(None, env).node.keys == str(tmp_path / "env/keys")


def test_config_d_lies_over_it_in_order(tmp_path: Path) -> None:
    """Tables are merged, lists are replaced, paths start where they are written; a mistake is told in its own file."""
    (tmp_path / "c.toml").write_text(NODE + '[mesh]\nconnect = ["tcp/a:1", "tcp/b:1"]\nsamples_per_s = 7\n')
    over = tmp_path / "config.d"
    over.mkdir()
    (over / "20.toml").write_text('[mesh]\nconnect = ["tcp/d:1"]\n')
    (over / "10.toml").write_text('[mesh]\nconnect = ["tcp/c:1"]\n[node]\nkeys = "../k"\nflights = "f"\n')
    config = load(str(tmp_path / "c.toml"), {})
    assert (config.mesh.connect, config.mesh.samples_per_s) == (("tcp/d:1",), 7)
    assert config.node.keys == str(tmp_path / "k")
    assert config.node.flights == str(over / "f")
    assert config.node.projections == str(tmp_path / "p.db")
    (over / "20.toml").write_text("\n[scan]\nlook_s = 0\n")
    (over / "30.toml").write_text("[[mesh")
    with pytest.raises(ConfigurationError, match=r"30\.toml:1: is no TOML"):
        load(str(tmp_path / "c.toml"), {})
    (over / "30.toml").unlink()
    with pytest.raises(ConfigurationError, match=r"20\.toml:3: scan\.look_s: must be greater than 0"):
        load(str(tmp_path / "c.toml"), {})


def test_config_d_is_read_in_the_order_of_names(tmp_path: Path) -> None:
    """Whatever order the folder lists them in, the last name wins, and every step of the way up to it."""
    (tmp_path / "c.toml").write_text(NODE)
    (tmp_path / "config.d").mkdir()
    names = [f"{(7 * number) % 40:02}" for number in range(40)]
    for last in sorted(names, reverse=True):
        for name in names:
            (tmp_path / "config.d" / f"{name}.toml").write_text(f"[mesh]\nsamples_burst = {int(name) + 1}\n")
        assert load(str(tmp_path / "c.toml"), {}).mesh.samples_burst == int(last) + 1
        (tmp_path / "config.d" / f"{last}.toml").unlink()
        names.remove(last)


def check_lines(text: str, expected: dict[str, int]) -> None:
    """Say on which line each key stands."""
    assert {".".join(key): line for key, line in lines_of(text).items()} == expected


def test_lines_of_odd_toml() -> None:
    """Dotted and quoted keys, texts and lists over several lines, inline tables, lists of tables."""
    check_lines(
        'a.b = 1\n"c d" = """\n[no]\nno = 1\n"""\n[e.f] # so\n  g = [\n # h = 1\n 2]\n',
        {"a": 1, "a.b": 1, "c d": 2, "e": 6, "e.f": 6, "e.f.g": 7},
    )
    check_lines(
        "\n[[m]]\nn = '='\ni = {j = 1, k = {l = 2}}",
        {"m": 2, "m.n": 3, "m.i": 4, "m.i.j": 4, "m.i.k": 4, "m.i.k.l": 4},
    )


@given(st.text(max_size=80))
def test_any_text_is_a_configuration_or_an_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    """Whatever is in the file, the answer is an error for people."""
    file = tmp_path_factory.getbasetemp() / "any.toml"
    file.write_bytes(text.encode(errors="surrogatepass"))
    with pytest.raises(ConfigurationError):
        load(str(file), {})


@pytest.mark.parametrize("name", ["video.toml", "drone.toml"])
def test_examples_are_good(name: str) -> None:
    """What is shown can be used."""
    config = load(str(EXAMPLES / name), {}, inputs=False)
    assert config.schema_version == 1


def run_check(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[int, str, str]:
    """Run the command as a shell would; return its code, its data and its words."""
    parser = argparse.ArgumentParser()
    check.add(parser.add_subparsers())
    parsed = parser.parse_args(["check", *args])
    code = parsed.run(parsed)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_check_of_a_good_file(capsys: pytest.CaptureFixture[str]) -> None:
    """Code 0 and what the node will do."""
    code, out, err = run_check(capsys, "--config", str(EXAMPLES / "drone.toml"), "--elsewhere")
    assert (code, err) == (0, "")
    assert "orders: taken; the camera from roles operator, pilot" in out
    code, out, _ = run_check(capsys, "--config", str(EXAMPLES / "drone.toml"), "--elsewhere", "--json")
    assert json.loads(out)["good"] is True
    assert code == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "no"),
        ("[flight]\nenabled = true\n", "failsafes and orders"),
        (MISSION, "failsafes; a mission of http://office, begun when a person of no role: nobody may lets it"),
        (
            MISSION + '[flight]\nenabled = true\n[command]\nenabled = true\nflight_roles = ["pilot", "chief"]\n',
            "failsafes and orders; a mission of http://office, begun when a person of pilot, chief lets it",
        ),
        (MISSION + 'begin = "alone"', "failsafes; a mission of http://office, begun by itself"),
    ],
)
def test_check_says_who_commands_the_flight(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, expected: str
) -> None:
    """A switch that was forgotten, or set by mistake, is seen before the flight."""
    (tmp_path / "c.toml").write_text(NODE + text)
    _, out, err = run_check(capsys, "--config", str(tmp_path / "c.toml"))
    assert (err, f"  the flight commanded by this node: {expected}\n" in out) == ("", True)


@pytest.mark.parametrize(
    ("url", "token", "host"),
    [
        ("http://office.example:8088", True, "office.example"),
        ("http://10.13.0.1", True, "10.13.0.1"),
        ("http://[fd00::1]:80/x", True, "fd00::1"),
        ("http://localhost.example", True, "localhost.example"),
        ("http://[", True, "the office"),
        ("http://office.example:8088", False, ""),
        ("https://office.example", True, ""),
        ("http://127.0.0.1:8088", True, ""),
        ("http://127.9.9.9", True, ""),
        ("http://[::1]:8088", True, ""),
        ("http://LocalHost:8088", True, ""),
    ],
)
def test_check_warns_of_a_token_that_is_sent_in_plain(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, url: str, token: bool, host: str
) -> None:
    """Words on stderr and in the JSON; the configuration is good all the same."""
    (tmp_path / "token").write_text("secret")
    (tmp_path / "token").chmod(0o600)
    text = MISSION.replace("http://office", url) + f'token_file = "{tmp_path / "token"}"\n' * token
    (tmp_path / "c.toml").write_text(NODE + text)
    expected = [f"mission.url: whoever is on the way to {host} reads the token of token_file; use https://"] * bool(
        host
    )
    code, out, err = run_check(capsys, "--config", str(tmp_path / "c.toml"))
    assert (code, err) == (0, "".join(f"autopilot: warning: {one}\n" for one in expected))
    assert out.startswith("the configuration is good\n")
    code, out, _ = run_check(capsys, "--config", str(tmp_path / "c.toml"), "--json")
    assert (code, json.loads(out)["good"], json.loads(out)["warnings"]) == (0, True, expected)


def test_check_of_a_bad_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Code 78, the problems as words, and as JSON where asked for."""
    file = tmp_path / "c.toml"
    file.write_text(NODE + "[scan]\nloook_s = 3\n")
    code, out, err = run_check(capsys, "--config", str(file))
    assert (code, out) == (78, "")
    assert err == f'{file}:6: scan.loook_s: is not a key of the configuration; did you mean "look_s"?\n'
    code, out, _ = run_check(capsys, "--config", str(file), "--json")
    (problem,) = json.loads(out)["problems"]
    assert json.loads(out)["warnings"] == []
    assert (code, problem["line"], problem["key"]) == (78, 6, "scan.loook_s")
    code, _, err = run_check(capsys, "--config", str(EXAMPLES / "drone.toml"))
    assert code == 78
    assert "eyes.model: no file /var/lib/autopilot/models/detector.onnx" in err


def test_schema(capsys: pytest.CaptureFixture[str]) -> None:
    """A JSON Schema that forbids unknown keys and explains the known ones."""
    code, out, _ = run_check(capsys, "--schema")
    schema = json.loads(out)
    assert code == 0
    assert schema["additionalProperties"] is False
    assert "description" in schema["$defs"]["EyesSection"]["properties"]["confidence"]


def config_of(**tables: object) -> Config:
    """Make a configuration without a file."""
    return Config.model_validate({"node": {"keys": "k", "flights": "f", "projections": "p"}, **tables})


def test_the_manifest_has_every_limit_in_its_unit() -> None:
    """No field of Limits is left out, and the units are those of flight.proto."""
    message = configuration_message(
        config_of(
            command={"enabled": True, "camera_roles": ["b", "a"], "flight_roles": ["d", "c"]},
            scan={"look_s": 2.5},
            flight={"enabled": True},
            safety={"fence_ahead_s": 2.5},
        )
    )
    limits = message.limits
    written = {field.name for field, _ in limits.ListFields()}
    assert {field.name for field in limits.DESCRIPTOR.fields} - written == set()
    assert (limits.flight_enabled, limits.battery_return_percent, limits.battery_land_percent) == (True, 25, 15)
    assert (limits.operator_degraded_ms, limits.operator_lost_ms) == (5_000, 30_000)
    assert (limits.operator_lost_following_ms, limits.failsafe_again_ms) == (30_000, 5_000)
    assert (limits.fence_ahead_ms, limits.override_longest_ms) == (2_500, 600_000)
    assert (list(limits.camera_roles), list(limits.flight_roles)) == (["a", "b"], ["c", "d"])
    assert (limits.command_enabled, limits.operator_hold_ms, limits.release_pause_ms) == (True, 60_000, 3_000)
    assert (limits.arrival_tolerance_cdeg, limits.arrival_patience_ms, limits.dedup_keep_ms) == (
        100,
        10_000,
        86_400_000,
    )
    assert (limits.same_object_mm, limits.same_poi_mm, limits.ask_confidence_e4) == (8_000, 15_000, 4_000)
    assert (limits.asks_per_minute, limits.decide_shortest_ms, limits.decide_longest_ms) == (5, 30_000, 120_000)
    assert (limits.queue_longest_ms, limits.ask_again_ms, limits.look_ms) == (300_000, 300_000, 2_500)
    assert (limits.frame_rate_floor_mhz, limits.sweep_pitch_cdeg, limits.scan_enabled) == (10_000, -3_500, False)
    assert (limits.failures_to_safe_mode, limits.failure_window_ms, limits.sightings_to_ask) == (3, 60_000, 3)
    assert limits.own_command_life_ms == 5_000


def test_the_manifest_has_groups_cameras_and_digest() -> None:
    """Groups by name; a fixed camera has no gimbal; where the node keeps its things is not in the digest."""
    pose = {"latitude_deg": 1, "longitude_deg": 2, "height_m": 3, "pitch_deg": -4}
    message = configuration_message(config_of(find={"groups": {"b": ["y", "x"], "a": ["z"]}}, eyes={"pose": pose}))
    assert [(group.name, list(group.classes)) for group in message.class_groups] == [("a", ["z"]), ("b", ["x", "y"])]
    assert [(camera.vehicle, camera.camera, camera.gimbal) for camera in message.cameras] == [(1, 1, 0)]
    plain = configuration_message(config_of())
    assert plain.cameras[0].gimbal == 1
    assert len(plain.digest) == 32
    assert plain.digest != message.digest
    moved = config_of(node={"keys": "/other", "flights": "f", "projections": "p"})
    assert configuration_message(moved).digest == plain.digest
