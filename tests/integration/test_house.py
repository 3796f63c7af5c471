"""The house's own rules, read from the sources: includes point one way, the solver stays pure."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# What each room may include of the others.
MAY_INCLUDE = {
    "server/base": {"base"},
    "server/solver": {"base", "solver"},
    "server/rig": {"base", "solver", "rig"},
    "server/import": {"base", "rig", "import"},
    "protocol": {"base", "protocol"},
    "server/session": {"base", "solver", "rig", "session", "protocol/limits.h",
                       "protocol/author.h"},
    "server/journal": {"base", "solver", "rig", "session", "journal", "protocol/limits.h",
                       "protocol/author.h"},
    "server/net": {"base", "protocol", "net"},
    "server/requests": {"base", "solver", "rig", "import", "session", "journal", "net", "protocol",
                        "requests"},
    "clients/cli": {"base", "protocol", "cli", "generate"},
}
ROOMS = {"base", "solver", "rig", "import", "session", "journal", "net", "protocol", "requests",
         "daemon.h"}

# The C headers that a pure room may use.
PURE_HEADERS = {
    "float.h", "limits.h", "math.h", "stdbool.h", "stddef.h", "stdint.h", "string.h",
}
IMPURE_CALLS = re.compile(r"\b(malloc|calloc|realloc|free|printf|fprintf|time|clock_gettime|skd_log)\s*\(")


def sources(room: str) -> list[Path]:
    return sorted(path for path in (ROOT / room).rglob("*") if path.suffix in {".c", ".h", ".cpp"})


def includes(path: Path) -> list[tuple[str, str]]:
    """(bracket, name) of each include: '"' for ours, '<' for others'."""
    return re.findall(r'^\s*#\s*include\s*(["<])([^">]+)[">]', path.read_text(), re.MULTILINE)


@pytest.mark.parametrize("room", MAY_INCLUDE)
def test_includes_point_one_way(room: str) -> None:
    files = sources(room)
    assert files, f"{room} has no sources"
    for path in files:
        for bracket, name in includes(path):
            head = name.split("/")[0]
            if bracket == '"' and head in ROOMS:
                allowed = MAY_INCLUDE[room]
                assert head in allowed or name in allowed, f"{path.relative_to(ROOT)} includes {name}"


def test_solver_is_pure() -> None:
    for path in sources("server/solver"):
        for bracket, name in includes(path):
            assert bracket == '"' or name in PURE_HEADERS, f"{path.name} includes <{name}>"
        code = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.DOTALL)
        found = IMPURE_CALLS.search(code)
        assert found is None, f"{path.name} calls {found.group(1)}"


def test_one_cpp_file() -> None:
    found = [path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.cpp")
             if "build" not in path.relative_to(ROOT).parts]
    assert found == ["server/rig/gltf_import.cpp"]


def test_files_stay_small() -> None:
    for room in MAY_INCLUDE:
        for path in sources(room):
            lines = path.read_text().count("\n")
            limit = 200 if path.suffix == ".h" else 800
            assert lines <= limit, f"{path.relative_to(ROOT)} has {lines} lines; {limit} is the limit"
