"""The generated code is what the schema generates: written again into a temporary folder, byte for byte."""

from __future__ import annotations

import sys
from pathlib import Path

import grpc_tools
import pytest
from grpc_tools import protoc

from tests.house import REPO

FOLDERS = ("events/schema", "autopilot/wire")


def generate(root: Path, out: Path) -> None:
    """Run the pinned compiler as `make proto` does, on the protos below `root`."""
    protos = sorted(
        proto.relative_to(root).as_posix() for folder in FOLDERS for proto in (root / folder).glob("*.proto")
    )
    plugin = Path(sys.executable).with_name("protoc-gen-mypy")
    includes = Path(grpc_tools.__file__).with_name("_proto")
    arguments = [f"-I{root}", f"-I{includes}", f"--python_out={out}", f"--mypy_out=quiet:{out}"]
    code = protoc.main(["protoc", *arguments, f"--plugin=protoc-gen-mypy={plugin}", *protos])
    assert code == 0, "protoc rejects a schema; its words are above"


def generated(root: Path) -> dict[str, bytes]:
    """Return the generated files below `root` by path."""
    files = (file for folder in FOLDERS for file in (root / folder).glob("*_pb2.py*"))
    return {file.relative_to(root).as_posix(): file.read_bytes() for file in files}


def stale(root: Path, out: Path) -> list[str]:
    """Return the generated files below `root` that differ from what its schema generates, or lack it."""
    generate(root, out)
    here, fresh = generated(root), generated(out)
    return sorted(path for path in here.keys() | fresh.keys() if here.get(path) != fresh.get(path))


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Make the folder that the compiler writes to."""
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def test_generated_code_is_in_step(out: Path) -> None:
    """If this fails: `make proto`, and commit what it writes."""
    assert stale(REPO, out) == []


def test_a_changed_schema_is_noticed(tmp_path: Path, out: Path) -> None:
    """One field more, and the old code no longer counts as in step."""
    for folder in FOLDERS:
        (tmp_path / "in" / folder).mkdir(parents=True)
        for file in (REPO / folder).iterdir():
            if file.is_file():
                (tmp_path / "in" / folder / file.name).write_bytes(file.read_bytes())
    schema = tmp_path / "in" / "autopilot" / "wire" / "detections.proto"
    text = schema.read_text(encoding="utf-8")
    schema.write_text(text.replace("message DetectionBatch {", "message DetectionBatch {\n  bool dark = 99;"), "utf-8")
    expected = ["autopilot/wire/detections_pb2.py", "autopilot/wire/detections_pb2.pyi"]
    assert stale(tmp_path / "in", out) == expected
