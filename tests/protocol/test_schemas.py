"""The schemas, PROTOCOL.md, errors.def and the C decoder say the same."""

from __future__ import annotations

import copy
import re

import jsonschema
import pytest
import schemas
from core.wire import encode_notification, encode_request
from probe import ask
from schemas import ROOT

PROTOCOL = (ROOT / "protocol" / "PROTOCOL.md").read_text("utf-8")

MATRIX = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
ARRAYS = {
    "positions": [[0, 0, 0], [1, 0, 0.5]], "triangles": [[0, 1, 1]],
    "bones": {"names": ["hip"], "parents": [-1], "binds": [MATRIX]},
    "influence_offsets": [0, 1, 1], "influence_joints": [0], "influence_weights": [1.0],
}

# Every member of every request, once at least.
EXAMPLES = [
    ("hello", {"protocol": {"min": 1, "max": 2}, "token": "0f" * 32,
               "client": {"name": "a", "version": "1", "id": "a-1", "user": "Ann"}}),
    ("ping", {}),
    ("cancel", {"id": 3}),
    ("session.create", {"name": "a", "file": "/a.glb", "influences": 8, "fill": "hop",
                        "reduce": "largest", "durability": "second",
                        "history_bytes": 1 << 20}),
    ("session.create", ARRAYS),
    ("session.list", {}),
    ("session.info", {"session": "a"}),
    ("session.attach", {"session": "a", "revision": 3, "instance": "0123456789abcdef"}),
    ("session.detach", {"session": "a"}),
    ("session.close", {"session": "a"}),
    ("session.export", {"session": "a", "path": "/b.glb"}),
    ("session.set", {"session": "a", "durability": "off", "history_bytes": 1 << 30}),
    ("session.save", {"session": "a", "path": "/a.skind"}),
    ("session.open", {"path": "/a.skind", "name": "b"}),
    ("session.open", {"closed": "a"}),
    ("session.fork", {"session": "a", "name": "b"}),
    ("session.delete", {"session": "a"}),
    ("session.verify", {"session": "a"}),
    ("session.verify", {"path": "/a.skind"}),
    ("session.claim", {"session": "a", "bones": ["hip"], "vertices": [3]}),
    ("mesh.get", {"session": "a"}),
    ("pose.set", {"session": "a", "pose": "p", "clip": "walk", "time": 0.5}),
    ("pose.set", {"session": "a", "pose": "p", "matrices": [MATRIX, MATRIX]}),
    ("pose.set", {"session": "a", "pose": "p", "bend": 25, "seed": 1}),
    ("pose.evaluate", {"session": "a", "pose": "p", "vertices": [1, 2]}),
    ("stroke.apply", {"session": "a", "sequence": 7, "pose": "p", "vertices": [1], "positions": [[1, 2, 3]],
                      "stream": False, "method": "thesis", "constraint": "affine",
                      "stiffness": 0.1, "thesis_k": 0.1, "thesis_h": 1, "locked_bones": ["hip"],
                      "locked_vertices": [4]}),
    ("stroke.apply", {"session": "a", "pose": "p", "vertices": [1, 2],
                      "positions": [[1, 2, 3], [4, 5, 6]], "pin": "move", "slots": "evidence",
                      "guard": 1, "smooth": 0.2, "mix": 0.5, "mask": [0, 1], "residual": "rest"}),
    ("pins.list", {"session": "a"}),
    ("pins.get", {"session": "a", "pose": "p"}),
    ("pins.weigh", {"session": "a", "sequence": 7, "pose": "p", "weight": 2, "vertices": [1]}),
    ("pins.clear", {"session": "a", "sequence": 7, "pose": "p", "vertices": [1]}),
    ("pins.solve", {"session": "a", "sequence": 7, "pose": "p", "vertices": [1], "stream": False,
                    "constraint": "affine", "stiffness": 0.1, "slots": "evidence", "guard": 0,
                    "smooth": 1, "residual": "shape", "locked_bones": [], "locked_vertices": []}),
    ("guard.set", {"session": "a", "poses": ["p"], "clips": ["walk", "run"],
                   "matrices": [MATRIX], "count": 12}),
    ("guard.get", {"session": "a"}),
    ("shapes.list", {"session": "a"}),
    ("shapes.get", {"session": "a", "pose": "p"}),
    ("session.refit", {"session": "a", "sequence": 7, "poses": ["p", "q"], "positions": [[1, 2, 3], [4, 5, 6]],
                       "stiffness": 0.01, "slots": "keep", "rounds": 2}),
    ("weights.get", {"session": "a", "vertices": [0]}),
    ("weights.set", {"session": "a", "sequence": 7, "vertices": [0, 2],
                     "weights": [[1, 0, 0, 0], [0.5, 0.5, 0, 0]]}),
    ("weights.set", {"session": "a", "vertices": [1], "weights": [[0, 0, 0, 0, 0, 0, 0, 1]]}),
    ("weights.set", {"session": "a", "vertices": [1], "weights": [[1, 0, 0, 0]],
                     "joints": [[3, 65535, 65535, 65535]], "rest": [[0, 1, 2]], "shape": "p",
                     "offsets": [[0, 0, 0.5]]}),
    ("weights.set", {"session": "a", "vertices": [1], "weights": [0.25, 0.25, 0.25, 0.25]}),
    ("weights.mirror", {"session": "a", "sequence": 7, "axis": "y", "from": "-", "origin": 0.5,
                        "tolerance": 0.01, "vertices": [1]}),
    ("weights.prune", {"session": "a", "sequence": 7, "below": 0.1, "vertices": [1]}),
    ("weights.reduce", {"session": "a", "sequence": 7, "influences": 3, "poses": ["p"], "vertices": [1]}),
    ("weights.reduce", {"session": "a", "influences": 3, "by": "size"}),
    ("history.undo", {"session": "a", "sequence": 7, "own": True}),
    ("history.redo", {"session": "a", "sequence": 7, "own": True}),
    ("stats", {}),
    ("shutdown", {}),
]

WRONG = [None, True, 0, -1, 1.5, 1e300, "", "x", "a/b", "/", "x" * 65, [], [[]], [[1, 2]], ["x"],
         [1.5, 2], {}, {"buffer": 0}, {"buffer": "0"}]


# Members of what the daemon sends that come only where there is something to say.
SOMETIMES = {"repeated", "damage", "changes"}
LINES_LEAVE_OUT = {"session.claims.notification": {"vertices"}}


def walk(schema, path=()):
    """Every schema within a schema."""
    if isinstance(schema, dict):
        yield path, schema
        for name, value in schema.items():
            yield from walk(value, (*path, name))
    elif isinstance(schema, list):
        for i, value in enumerate(schema):
            yield from walk(value, (*path, i))


def test_every_method_has_its_schemas():
    expected = {"common", "error", "message"}
    for method in schemas.methods():
        expected.add(f"{method}.request")
        if method != "cancel":  # a notification; nothing answers it
            expected.add(f"{method}.result")
    expected |= {f"{name}.notification"
                 for name in ("stroke.weights", "session.update", "session.closed", "bye",
                              "session.presence", "session.claims", "journal.suspended",
                              "journal.resumed")}
    assert set(schemas.load_all()) == expected
    assert len(schemas.methods()) == 40
    counted = schemas.load_all()["stats.result"]["properties"]["requests"]["propertyNames"]
    assert counted["enum"] == schemas.methods()


@pytest.mark.parametrize("name", sorted(schemas.load_all()))
def test_schema_is_sound(name):
    schema = schemas.load_all()[name]
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["title"]
    resolver = schemas.validator(name).resolver
    for _, part in walk(schema):
        if isinstance(part.get("$ref"), str):
            _, target = resolver.resolve(part["$ref"])
            assert isinstance(target, dict)


@pytest.mark.parametrize("name", sorted(schemas.load_all()))
def test_what_the_daemon_sends_is_strict(name):
    """Nothing unknown and nothing missing in results and notifications, but for what is named as
    coming together with something else; requests are open."""
    is_open = name.endswith(".request")
    if name in ("common", "message"):
        return
    for path, part in walk(schemas.load_all()[name]):
        if "properties" in part and path[-1:] != ("properties",):
            assert ("additionalProperties" in part) != is_open, path
            if not is_open:
                required = set(part["required"]) | LINES_LEAVE_OUT.get(name, set())
                for choice in (*part.get("oneOf", []), *part.get("anyOf", [])):
                    required |= set(choice["required"])
                required |= set(part.get("dependentRequired", ()))
                assert required | (SOMETIMES & set(part["properties"])) == set(
                    part["properties"]), path


def table(heading):
    """The rows of the first table below a heading of PROTOCOL.md, as lists of cells."""
    section = PROTOCOL.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    rows = [line.strip().strip("|").split("|") for line in section.splitlines()
            if line.startswith("| `")]
    return [[cell.strip() for cell in row] for row in rows]


def members(schema):
    """Names of a schema's members and of theirs."""
    names = set()
    if schema.get("$ref", "").endswith(".result.json"):  # the result of another method
        schema = schemas.load_all()[schema["$ref"].removesuffix(".json")]
    for _, part in walk(schema):
        for name in part.get("properties", {}) if isinstance(part.get("properties"), dict) else {}:
            names.add(name)
    return names


def words(cell):
    """All words within backticks, `[name]` as well as `a b: {c}`."""
    return set(re.findall(r"[a-z_0-9]+", " ".join(re.findall(r"`([^`]*)`", cell))))


def test_the_table_of_requests_is_the_schemas():
    rows = {}
    for cells in table("Requests"):
        for method in re.findall(r"`([a-z.]+)`", cells[0]):
            rows[method] = cells[1:]
    assert set(rows) == set(schemas.methods())
    for method, (params, result) in rows.items():
        wanted = members(schemas.load_all()[f"{method}.request"])
        assert wanted <= words(params), f"{method}: {wanted - words(params)} not in PROTOCOL.md"
        if method in ("cancel", "stroke.apply"):
            continue  # no result; told below the table
        wanted = members(schemas.load_all()[f"{method}.result"])
        if method == "session.info":
            result += rows["session.list"][1]  # which its cell refers to
        same = re.match(r"as `([a-z.]+)`", result)
        if same:
            assert wanted <= members(schemas.load_all()[f"{same[1]}.result"]), method
            continue
        assert wanted <= words(result), f"{method}: {wanted - words(result)} not in PROTOCOL.md"
    answer = PROTOCOL.split("`stroke.apply` answers", 1)[1].split("}`", 1)[0] + "}`"
    assert words(answer) >= members(schemas.load_all()["stroke.apply.result"])


def test_the_table_of_notifications_is_the_schemas():
    rows = {cells[0].strip("`"): cells[1] for cells in table("Notifications from the daemon")}
    assert sorted(rows) == schemas.notifications()
    for name, cell in rows.items():
        wanted = set(schemas.load_all()[f"{name}.notification"]["properties"])
        assert wanted <= words(cell), name


def test_the_registry_of_errors_is_the_schema():
    text = (ROOT / "protocol" / "errors.def").read_text("utf-8")
    rows = re.findall(r'^X\(SKD_(\w+), (-?\d+), "(\w+)", (true|false), "((?:[^"\\]|\\.)*)"\)$',
                      text, re.MULTILINE)
    assert len(rows) == text.count("\nX(")
    schema = schemas.load_all()["error"]["properties"]
    assert schema["code"]["enum"] == [int(row[1]) for row in rows]
    assert schema["data"]["properties"]["name"]["enum"] == [row[2] for row in rows]
    for status, _, name, _, _ in rows:
        assert status.lower() == name


def encode(method, params, i):
    if method == "cancel":
        return encode_notification(method, params)
    return encode_request(i, method, params)


def test_examples_hold_every_member():
    for method in schemas.methods():
        given = set()
        for name, params in EXAMPLES:
            if name == method:
                given |= set(params)
        assert given == set(schemas.load_all()[f"{method}.request"]["properties"]), method


def variants(params):
    """Small faults: each member left out, and each replaced by each wrong value."""
    for name in params:
        yield {key: value for key, value in params.items() if key != name}
        for wrong in WRONG:
            yield {**params, name: wrong}
        if isinstance(params[name], dict):
            for inner in variants(params[name]):
                yield {**params, name: inner}
    yield {**params, "no_such_member": [1]}


# What the decoder refuses and a schema cannot: ties between members, lengths that are no multiple.
BEYOND_SCHEMAS = {"count_mismatch", "not_finite"}
BEYOND_SENTENCES = ("rows of", "protocol.min is")


def holds_reference(value):
    """Whether there is {"buffer": 0} in it, and no buffer is sent with these cases."""
    if isinstance(value, dict):
        return value == {"buffer": 0} or any(map(holds_reference, value.values()))
    return False


@pytest.mark.parametrize("index", range(len(EXAMPLES)),
                         ids=[f"{i}-{name}" for i, (name, _) in enumerate(EXAMPLES)])
def test_the_decoder_and_the_schema_agree(probe_path, index):
    """What the schema takes the decoder takes, and the other way round."""
    method, example = EXAMPLES[index]
    cases = [example, *map(copy.deepcopy, variants(example))]
    answers = ask(probe_path, (encode(method, case, i) for i, case in enumerate(cases)))
    assert len(answers) == len(cases)
    assert answers[0].error is None, answers[0].error
    schema = schemas.validator(f"{method}.request")
    for i, (case, answer) in enumerate(zip(cases, answers)):
        assert answer.id == (None if method == "cancel" else i)
        by_schema, error = schema.is_valid(case), answer.error
        if error is None:
            assert by_schema, case
            continue
        schemas.check("message", answer.raw, "failure")
        assert error.message.startswith(f"{method}: ")
        is_beyond = (error.name in BEYOND_SCHEMAS or holds_reference(case)
                     or any(words in error.message for words in BEYOND_SENTENCES))
        assert not by_schema or is_beyond, (case, error)
