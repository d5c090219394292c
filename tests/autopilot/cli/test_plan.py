"""`autopilot plan`: what it lists, what it draws, how it ends."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from autopilot.cli import plan
from autopilot.ground.canvas import Pen, Pixels, Svg
from tests.autopilot.planning.missions import fence, region, tree, waypoint
from tests.house import REPO

MISSIONS = REPO / "examples" / "missions"
FIELD = MISSIONS / "field.json"
PLANE = ("--airframe", "plane", "--speed", "16", "--wind-from", "250", "--wind", "6")


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Run the command as a shell would; return its code, its data and its words."""
    parser = argparse.ArgumentParser()
    plan.add(parser.add_subparsers())
    parsed = parser.parse_args(["plan", *words])
    code = parsed.run(parsed)
    said = capsys.readouterr()
    return code, said.out, said.err


def as_json(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """Return a plan that can be flown."""
    code, out, err = run(capsys, *words, "--json")
    assert (code, err) == (0, "")
    made: dict[str, Any] = json.loads(out)
    return made


def check_ends(capsys: pytest.CaptureFixture[str], code: int, words: str, *arguments: str) -> None:
    """Check that nothing is listed, the exit code, and what is said."""
    found, out, err = run(capsys, *arguments)
    assert (found, out) == (code, "")
    assert words in err


def test_the_items_are_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    """One line an item, then the searches, breakpoints and notes."""
    code, out, err = run(capsys, str(FIELD))
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert lines[0].split() == ["seq", "command", "latitude", "longitude", "height", "parameters", "item"]
    assert lines[1].split() == ["0", "NAV_TAKEOFF", "47.5402000", "8.7214000", "40", "m", "0", "0", "0", "-", "-"]
    assert lines[2].split() == ["1", "DO_CHANGE_SPEED", "-", "-", "-", "1", "8", "-1", "0", "0"]
    table = lines[1 : lines.index("")]
    assert [line.split()[0] for line in table] == [str(seq) for seq in range(len(table))]
    text = "\n".join(lines[lines.index("") :])
    assert "item 1: 13.66 ha in 16 lanes" in text
    assert f"item 2: breakpoint before seq {len(table) - 3}" in text
    assert "note: items[1]: 0.64 ha of the region are forbidden by the fences and not searched" in text


@pytest.mark.parametrize(
    ("name", "words"), [("field", ()), ("bay", ()), ("corridor", PLANE)], ids=["field", "bay", "corridor"]
)
def test_the_examples_see_all_but_nothing(
    capsys: pytest.CaptureFixture[str], name: str, words: tuple[str, ...]
) -> None:
    """What is shown can be flown, and sees more than 98 % of every region."""
    made = as_json(capsys, str(MISSIONS / f"{name}.json"), *words)
    assert made["searched"]
    assert [region for region in made["searched"] if region["coverage"] < 0.98] == []
    assert made["items"][-1]["auto_continue"] is False


def test_flags_change_the_plan(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Each flag is a key of [mission]; a configuration is under them."""
    file = tmp_path / "m.json"
    file.write_text(json.dumps(tree(region(height_m=None))))
    config = tmp_path / "c.toml"
    head = '[node]\nkeys = "k"\nflights = "f"\nprojections = "p"\n'
    config.write_text(head + "[eyes]\nfield_of_view_deg = 30\n[mission]\nsearch_height_m = 90\nside_overlap = 0.0\n")

    def swath_m(*words: str) -> int:
        metres: float = as_json(capsys, str(file), *words)["searched"][0]["swath_m"]
        return round(metres)

    def lanes(*words: str) -> int:
        return int(as_json(capsys, str(file), *words)["searched"][0]["lanes"])

    assert (swath_m(), swath_m("--height", "30"), swath_m("--fov", "90")) == (69, 35, 120)
    assert (swath_m("--config", str(config)), swath_m("--config", str(config), "--height", "45")) == (48, 24)
    assert (lanes(), lanes("--overlap", "0.5"), lanes("--config", str(config), "--overlap", "0.5")) == (4, 6, 9)
    windy = as_json(capsys, str(file), *PLANE)
    assert (windy["airframe"], windy["items"][0]["command"]) == ("plane", 16)
    assert as_json(capsys, str(file), "--speed", "4")["time_s"] > as_json(capsys, str(file), "--speed", "8")["time_s"]
    moved = as_json(capsys, str(file), "--home", "47.541", "8.722")
    assert (moved["home"]["lat_e7"], moved["items"][0]["lon_e7"]) == (475_410_000, 87_220_000)


def test_the_margin_is_a_flag_too(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A wider one keeps lanes farther from the fence."""
    file = tmp_path / "m.json"
    yard = fence([(-100, -100), (350, -100), (350, 400), (-100, 400)], "INCLUSION")
    file.write_text(json.dumps(tree(region(), fences=[yard])))
    near, far = (as_json(capsys, str(file), "--margin", metres)["searched"][0]["coverage"] for metres in ("5", "60"))
    assert near > far


def test_what_a_vehicle_is_sent(capsys: pytest.CaptureFixture[str]) -> None:
    """ArduPilot's home is listed where it is asked for."""
    plain = as_json(capsys, str(FIELD))["items"]
    assert as_json(capsys, str(FIELD), "--autopilot", "px4")["items"] == plain
    sent = as_json(capsys, str(FIELD), "--autopilot", "ardupilot")["items"]
    assert (len(sent), sent[0]["command"], sent[0]["current"]) == (len(plain) + 1, 16, True)
    assert [item for item in sent if None in item["params"]] == []


def test_how_it_ends(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Every way, with words."""
    bad = tmp_path / "bad.json"
    bad.write_text(json.dumps(tree(waypoint((1, 1))) | {"items": []}))
    check_ends(capsys, 65, "$.items: has 0 entries, fewer than 1", str(bad))
    bad.write_text(json.dumps(tree(waypoint((90_000, 1)))))
    check_ends(capsys, 65, "$.items[0].at: is 90.0 km from home", str(bad))
    check_ends(capsys, 66, "none.json: No such file", str(tmp_path / "none.json"))
    check_ends(capsys, 2, "name a file that ends with .svg or .png", str(FIELD), "--out", "x.jpg")
    check_ends(capsys, 2, "--overlap: must be less than or equal to 0.95", str(FIELD), "--overlap", "2")
    check_ends(capsys, 2, "--home is latitude (+-90)", str(FIELD), "--home", "95", "8")
    check_ends(capsys, 73, "No such file or directory", str(FIELD), "--out", str(tmp_path / "no" / "x.svg"))
    config = tmp_path / "c.toml"
    config.write_text("[mission]\nside_overlap = 3\n")
    check_ends(capsys, 78, "mission.side_overlap", str(FIELD), "--config", str(config))


def texts(file: Path) -> list[str]:
    """Return what is written on an SVG."""
    tree = ElementTree.fromstring(file.read_text(encoding="utf-8"))
    return [element.text or "" for element in tree.iter("{http://www.w3.org/2000/svg}text")]


def test_an_svg_has_everything_on_it(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Title, north, scale, home, heights, and a legend of what is there and of nothing else."""
    out = tmp_path / "field.svg"
    code, _, err = run(capsys, str(FIELD), "--out", str(out))
    assert (code, err) == (0, f"drawn in {out}\n")
    written = texts(out)
    for words in ("Mission field", "N", "home", "100 m", "waypoint 40 m", "search 35 m", "lane", "between", "back"):
        assert words in written
    assert "[1] search from 40 m, 99.9 % seen" in written
    assert {"inclusion", "exclusion", "seen"} <= set(written)
    lonely = tmp_path / "m.json"
    lonely.write_text(json.dumps(tree(waypoint((10, 20)))))
    run(capsys, str(lonely), "--out", str(out))
    assert set(texts(out)) & {"lane", "between", "inclusion", "exclusion", "seen", "not seen"} == set()


def test_the_picture_in_the_docs_is_what_is_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """If this fails: `autopilot plan examples/missions/bay.json --out docs/pictures/bay.svg`, and look at it."""
    out = tmp_path / "bay.svg"
    run(capsys, str(MISSIONS / "bay.json"), "--out", str(out))
    assert texts(out) == texts(REPO / "docs" / "pictures" / "bay.svg")


def test_a_png_is_the_same_picture(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A picture of the SVG's size with its colours in it."""
    run(capsys, str(FIELD), "--out", str(tmp_path / "f.svg"))
    run(capsys, str(FIELD), "--out", str(tmp_path / "f.png"))
    image = cv2.imread(str(tmp_path / "f.png"))
    assert image is not None
    head = ElementTree.fromstring((tmp_path / "f.svg").read_text(encoding="utf-8"))
    assert (image.shape[1], image.shape[0]) == (int(head.attrib["width"]), int(head.attrib["height"]))
    for colour in ("#1d5a96", "#f2b134", "#22303c"):
        blue, green, red = int(colour[5:7], 16), int(colour[3:5], 16), int(colour[1:3], 16)
        near = np.abs(image.astype(int) - [blue, green, red]).sum(axis=2) < 30
        assert near.sum() > 50, colour


def test_pixels_have_dashes_holes_and_anchors() -> None:
    """A dashed line has gaps, an area with a hole shows the paper, and a text in the middle is in the middle."""
    sheet = Pixels(200, 100, "#ffffff")
    sheet.line([(0, 50), (200, 50)], Pen(colour="#000000", width_px=2, dash_px=(10, 10)))
    row = _pixels(sheet)[50, :, 0]
    assert (row[5], row[15], row[25]) == (0, 255, 0)
    sheet = Pixels(200, 100, "#ffffff")
    sheet.area([[(10, 10), (90, 10), (90, 90), (10, 90)], [(40, 40), (60, 40), (60, 60), (40, 60)]], "#000000", 0.5)
    image = _pixels(sheet)
    assert (image[20, 20, 0], image[50, 50, 0]) == (128, 255)
    for anchor, middle in (("start", 100), ("middle", 100), ("end", 100)):
        sheet = Pixels(200, 100, "#ffffff")
        sheet.text((100, 50), "XXXX", 14, "#000000", anchor)
        columns = np.nonzero(_pixels(sheet)[:, :, 0].min(axis=0) < 128)[0]
        side = {"start": columns.min(), "middle": (columns.min() + columns.max()) / 2, "end": columns.max()}[anchor]
        assert abs(side - middle) <= 3, anchor


def _pixels(sheet: Pixels) -> Any:
    return cv2.imdecode(np.frombuffer(sheet.encoded(), np.uint8), cv2.IMREAD_COLOR)


def test_svg_escapes_what_is_written() -> None:
    """A mission's name is its author's."""
    sheet = Svg(10, 10, "#ffffff")
    sheet.text((0, 0), "<script>&", 10, "#000000")
    assert b"&lt;script&gt;&amp;</text>" in sheet.encoded()
