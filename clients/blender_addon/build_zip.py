# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the zip that users install: build_zip.py PROGRAMS OUTPUT

PROGRAMS is the folder that holds skind and skinctl, OUTPUT the folder for the zip; prints its path.
One zip for every Blender: a single folder `skind` is a package to install for those before 4.2, and
an extension, with its manifest, for those since. The same files give the same bytes.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
NAME = "skind"
PROGRAMS = ("skind", "skinctl")
DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can hold


class Unfit(Exception):
    """The zip cannot be built; the text is for whoever builds."""


def version() -> str:
    """The add-on's, which three places must agree on."""
    names = {}
    for node in ast.parse((HERE / "__init__.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and node.targets[0].id in ("bl_info", "__version__"):
            names[node.targets[0].id] = ast.literal_eval(node.value)
    manifest = tomllib.loads((HERE / "blender_manifest.toml").read_text(encoding="utf-8"))
    found = {".".join(map(str, names["bl_info"]["version"])), names["__version__"],
             manifest["version"]}
    if len(found) != 1:
        raise Unfit(f"bl_info, __version__ and the manifest differ: {', '.join(sorted(found))}")
    return found.pop()


def platform() -> str:
    """The one that the manifest names."""
    manifest = tomllib.loads((HERE / "blender_manifest.toml").read_text(encoding="utf-8"))
    return manifest["platforms"][0]


def check_program(path: Path, wanted: str) -> None:
    """It must run here, and be of the add-on's version."""
    try:
        said = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=30,
                              check=True).stdout.split()
    except (OSError, subprocess.SubprocessError) as error:
        raise Unfit(f"{path} does not run: {error}") from None
    if said != [path.name, wanted]:
        raise Unfit(f"{path} is {' '.join(said)}; the add-on is {wanted}")


def files(programs: Path) -> dict[str, Path]:
    """What goes in: its path in the zip, and the file."""
    own = [HERE / "__init__.py", HERE / "blender_manifest.toml", HERE / "LICENSE",
           HERE / "README.md", *(HERE / "core").glob("**/*.py"),
           *(HERE / "blender").glob("**/*.py")]
    result = {f"{NAME}/{path.relative_to(HERE).as_posix()}": path for path in own}
    for name in PROGRAMS:
        result[f"{NAME}/bin/{name}"] = programs / name
    result[f"{NAME}/bin/LICENSE"] = HERE.parents[1] / "LICENSE"  # the programs are MIT
    return result


def build(programs: Path, output: Path) -> Path:
    """Writes OUTPUT/skind-<version>-<platform>.zip and returns its path."""
    number = version()
    for name in PROGRAMS:
        check_program(programs / name, number)
    output.mkdir(parents=True, exist_ok=True)
    path = output / f"{NAME}-{number}-{platform()}.zip"
    part = path.with_suffix(".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for inside, file in sorted(files(programs).items()):
            entry = zipfile.ZipInfo(inside, DATE)
            entry.create_system = 3  # Unix, wherever it is built: the modes below are its
            mode = 0o755 if file.name in PROGRAMS else 0o644
            entry.external_attr = (0o100000 | mode) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, file.read_bytes())
    part.replace(path)
    return path


def main(arguments: list[str]) -> int:
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        print(build(Path(arguments[0]), Path(arguments[1])))
    except (Unfit, OSError) as error:
        print(f"build_zip: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
