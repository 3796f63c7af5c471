"""The zip that users install: what is in it, and that each Blender takes it."""

from __future__ import annotations

import os
import stat
import subprocess
import zipfile
from pathlib import Path

import pytest

from blenders import ADDON, BPY_ROOT, BPY_VERSIONS, DEBIAN, PYTHON, ROOT, Blender

BIN = Path(os.environ.get("SKIND_BUILD", ROOT / "build" / "release")) / "bin"
VERSION = "0.1.0"


def build(programs: Path, output: Path) -> subprocess.CompletedProcess:
    return subprocess.run([PYTHON, ADDON / "build_zip.py", programs, output], timeout=120,
                          capture_output=True, text=True)


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    done = build(BIN, tmp_path_factory.mktemp("zip"))
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


def test_the_same_files_give_the_same_bytes(archive: Path, tmp_path: Path) -> None:
    again = Path(build(BIN, tmp_path).stdout.strip())
    assert again.name == archive.name == f"skind-{VERSION}-linux-x64.zip"
    assert again.read_bytes() == archive.read_bytes()


def test_it_holds_the_package_and_nothing_else(archive: Path) -> None:
    with zipfile.ZipFile(archive) as opened:
        modes = {entry.filename: stat.S_IMODE(entry.external_attr >> 16)
                 for entry in opened.infolist()}
        for name in modes:
            inside = name.removeprefix("skind/")
            source = {"bin/LICENSE": ROOT / "LICENSE", "bin/skind": BIN / "skind",
                      "bin/skinctl": BIN / "skinctl"}.get(inside, ADDON / inside)
            assert opened.read(name) == source.read_bytes(), name
    sources = {f"skind/{path.relative_to(ADDON)}" for part in ("core", "blender")
               for path in (ADDON / part).glob("**/*.py")}
    others = {f"skind/{name}" for name in (
        "__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "bin/LICENSE",
        "bin/skind", "bin/skinctl")}
    assert set(modes) == sources | others
    assert {name for name, mode in modes.items() if mode == 0o755} == {
        "skind/bin/skind", "skind/bin/skinctl"}
    assert {mode for mode in modes.values()} == {0o644, 0o755}


def test_a_program_of_another_version_is_refused(tmp_path: Path) -> None:
    for name in ("skind", "skinctl"):
        (tmp_path / name).write_text(f"#!/bin/sh\necho {name} 9.9.9\n")
        (tmp_path / name).chmod(0o755)
    done = build(tmp_path, tmp_path / "out")
    assert done.returncode == 1
    assert "skind 9.9.9; the add-on is 0.1.0" in done.stderr
    assert not (tmp_path / "out").exists()


def test_blender_installs_it_and_the_programs_run(archive: Path, blender: Blender) -> None:
    if blender.version == DEBIAN:
        facts = blender.run("packages.install_addon", str(archive), addon=None)
        # What enabling has to mend; should Blender keep the modes one day, it has nothing to do.
        assert facts["unpacked"] == {"skind": False, "skinctl": False}
    else:
        facts = blender.run("packages.install_extension", str(archive), addon=None)
    assert Path(facts["file"]).is_relative_to(blender.home)
    assert facts["says"] == {"skind": f"skind {VERSION}", "skinctl": f"skinctl {VERSION}"}
    assert facts["candidates"] == [str(Path(facts["file"]).parent / "bin")]
    assert facts["entry"]
    assert "SKIND_PT_main" in facts["types"]
    assert facts["left"]["types"] == facts["left"]["modules"] == []


@pytest.mark.parametrize("series", BPY_VERSIONS)
def test_blenders_own_validation_accepts_it(archive: Path, series: str) -> None:
    command = (BPY_ROOT / f"bpy-{BPY_VERSIONS[series]}" / "bpy" / series / "scripts"
               / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py")
    done = subprocess.run([PYTHON, "-B", command, "validate", archive], timeout=60,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
