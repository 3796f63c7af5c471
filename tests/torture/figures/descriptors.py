"""All descriptors used up: newcomers are refused politely, those inside work on."""

from __future__ import annotations

import time
from pathlib import Path

from core import Link, SkindError

from .. import work
from ..yard import Yard, expect

LIMIT = 96  # descriptors
OUTSIDE = 150  # who want in


def try_in(path: Path) -> tuple[Link | None, str]:
    """A link, or how it was refused."""
    try:
        return Link.connect(path, timeout=5), ""
    except SkindError as error:
        return None, error.name
    except ConnectionError:
        return None, "hung up"


def measure(yard: Yard, seconds: float) -> dict:
    with yard.daemon(before=["prlimit", f"--nofile={LIMIT}:{LIMIT}"]) as daemon:
        inside = daemon.link()
        work.create(inside, "in")
        before = daemon.descriptors()
        links, refusals = [], []
        for _ in range(OUTSIDE):
            link, refusal = try_in(daemon.socket)
            if link is not None:
                links.append(link)
            else:
                refusals.append(refusal)
        expect(refusals and links, f"{len(links)} let in, {len(refusals)} refused of {OUTSIDE}")
        impolite = [refusal for refusal in refusals if refusal != "busy"]
        expect(not impolite, f"{len(impolite)} of {len(refusals)} refusals are {set(impolite)}")
        # Nobody asks for anything: it must not spin on the ones that it cannot take.
        began = daemon.cpu_seconds()
        time.sleep(1.0)
        spun = daemon.cpu_seconds() - began
        expect(spun <= 0.1, f"{spun:.2f} s of CPU in a second in which nobody asked")
        # Those inside have all that they had, files included.
        recipe = work.Recipe("in", 400, 1)
        for _ in range(20):
            inside.call(*recipe.stroke())
        for link in links:
            link.call("ping")
        inside.call("session.create", {"name": "more", **work.rigs.sheet(100)})
        work.check_simplex(inside, "in")
        for link in links:
            link.close()
        deadline = time.monotonic() + 5
        while daemon.descriptors() > before + 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        expect(daemon.descriptors() <= before + 3, "descriptors are left open")
        again, refusal = try_in(daemon.socket)
        expect(again is not None, f"with descriptors free again: {refusal}")
        again.close()
        inside.close()
    yard.say(f"  {len(links) + 1} inside, {len(refusals)} refused")
    return {"fd_exhausted": "pass"}
