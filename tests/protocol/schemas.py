"""Holds messages against protocol/schema, the truth of the wire. Other tests import this.

    with Link.connect(path, watch=schemas.watch()) as skind: ...

holds every message of that link, sent or received, against its schema. A test that sends bad
messages on purpose does not watch.
"""

from __future__ import annotations

import json
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import jsonschema

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "protocol" / "schema"

# Each schema that a message was held against, for tests that ask whether all were.
seen: set[str] = set()


@lru_cache
def load_all() -> dict[str, dict]:
    """Every schema by its file's stem."""
    return {path.stem: json.loads(path.read_text("utf-8")) for path in FOLDER.glob("*.json")}


@lru_cache
def validator(name: str, definition: str = "") -> jsonschema.Draft202012Validator:
    """Of a schema, or of one of its $defs. References go between the files, by name."""
    store = {(FOLDER / f"{stem}.json").as_uri(): schema for stem, schema in load_all().items()}
    base = (FOLDER / f"{name}.json").as_uri()
    schema = {"$ref": f"#/$defs/{definition}"} if definition else load_all()[name]
    resolver = jsonschema.RefResolver(base, load_all()[name], store=store)
    return jsonschema.Draft202012Validator(schema, resolver=resolver)


def check(name: str, value: Any, definition: str = "") -> None:
    """Raises jsonschema.ValidationError when the value is not what the schema says."""
    validator(name, definition).validate(value)
    if not definition:
        seen.add(name)


def methods() -> list[str]:
    """The methods that a client may call, from the C header."""
    header = (ROOT / "protocol" / "words.h").read_text("utf-8")
    return re.findall(r'X\(\w+, "([a-z.]+)"\)', header)


def notifications() -> list[str]:
    """Those of the daemon."""
    return sorted(name.removesuffix(".notification") for name in load_all()
                  if name.endswith(".notification"))


def unseen() -> set[str]:
    """Schemas of messages that nothing was held against yet."""
    return {name for name in load_all() if "." in name} - seen


class Watcher:
    """Checks one connection's messages; it remembers which method an answer belongs to."""

    def __init__(self) -> None:
        self._methods: dict[Any, str] = {}

    def __call__(self, direction: str, raw: dict) -> None:
        if direction == "sent":
            self._check_sent(raw)
        else:
            self._check_received(raw)

    def _check_sent(self, raw: dict) -> None:
        method = raw["method"]
        check("message", raw, "request" if "id" in raw else "sent_notification")
        check(f"{method}.request", raw.get("params", {}))
        if "id" in raw:
            self._methods[raw["id"]] = method

    def _check_received(self, raw: dict) -> None:
        if "method" in raw:
            check("message", raw, "own_notification")
            check(f"{raw['method']}.notification", raw["params"])
        elif "error" in raw:
            check("message", raw, "failure")
            check("error", raw["error"])
            self._methods.pop(raw["id"], None)
        else:
            check("message", raw, "answer")
            check(f"{self._methods.pop(raw['id'])}.result", raw["result"])


def watch() -> Watcher:
    """A watcher for one Link."""
    return Watcher()
