"""Coverage-guided fuzzing of all that takes a peer's bytes, with ASan and UBSan.

Two targets at a time, each from the inputs that are kept (tests/fuzz/corpus) and from what earlier
runs found (out/torture/fuzz). The value is the number of executions; a crash, a leak or a hang is a
failed figure, and its input lies in out/torture/fuzz.
"""

from __future__ import annotations

import os
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .. import ROOT
from ..yard import Failed, Yard

BIN = Path(os.environ.get("SKIND_FUZZ_BUILD", ROOT / "build" / "fuzz")) / "bin"
CORPUS = ROOT / "tests" / "fuzz" / "corpus"
LONGEST = {"frame": 4096, "session": 8192, "journal": 1 << 16, "gltf": 16384,
           "image": 16384}  # bytes of an input
# What a figure counts: a file becomes a rig, and the rig comes out of its process as an image.
PROGRAMS = {"fuzz_frame": ["frame"], "fuzz_session": ["session"], "fuzz_journal": ["journal"],
            "fuzz_gltf": ["gltf", "image"]}
AT_ONCE = 2


def write_dictionary(path: Path) -> None:
    """The words of the wire, for the fuzzers of JSON."""
    words = set(re.findall(r'"([a-z_.]{3,})"', "".join(
        (ROOT / "protocol" / name).read_text() for name in
        ("words.h", "words.c", "request.c", "request_checks.c", "request_fields.c"))))
    path.write_text("".join(f'"{word}"\n' for word in sorted(words)))


def fuzz(yard: Yard, target: str, seconds: float) -> int:
    """Executions without a finding."""
    program = BIN / f"fuzz_{target}"
    if not program.exists():
        raise Failed(f"{program} is not built")
    folder = ROOT / "out" / "torture" / "fuzz"
    found = folder / target
    found.mkdir(parents=True, exist_ok=True)
    log, words = yard.folder() / "log", yard.folder() / "words"
    write_dictionary(words)
    with log.open("wb") as output:
        done = subprocess.run(
            [program, f"-max_total_time={seconds:.0f}", f"-max_len={LONGEST[target]}",
             "-print_final_stats=1", "-timeout=25", "-rss_limit_mb=4096", "-reload=0",
             f"-artifact_prefix={folder}/{target}-", f"-dict={words}",
             found, CORPUS / target],
            stdout=output, stderr=output, timeout=seconds + 300)
    text = log.read_text(errors="replace")
    executed = re.search(r"stat::number_of_executed_units:\s*(\d+)", text)
    if done.returncode != 0 or executed is None:
        why = re.search(r"^.*(?:ERROR: |SUMMARY: |bug: ).*$", text, re.MULTILINE)
        (folder / f"{target}.log").write_text(text[-100_000:])
        raise Failed(f"fuzz_{target}: {why.group(0) if why else text[-300:]}; see {folder}")
    yard.say(f"  fuzz_{target}: {int(executed.group(1)):,} executions")
    return int(executed.group(1))


def measure(yard: Yard, seconds: float) -> dict:
    share = seconds * AT_ONCE / len(LONGEST)
    values: dict[str, int | None] = {}
    with ThreadPoolExecutor(AT_ONCE) as pool:
        running = {target: pool.submit(fuzz, yard, target, share) for target in LONGEST}
        for key, targets in PROGRAMS.items():
            try:
                values[key] = sum(running[target].result() for target in targets)
            except Failed as failure:
                values[key] = None
                yard.say(f"  {failure}")
    return values
