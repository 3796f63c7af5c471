"""Small skinned glTF files with one awkward thing each, made on the spot."""

import base64
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

TYPES = {np.dtype("i1"): 5120, np.dtype("u1"): 5121, np.dtype("<i2"): 5122, np.dtype("<u2"): 5123,
         np.dtype("<u4"): 5125, np.dtype("<f4"): 5126}  # fmt: skip
NAMES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


@dataclass
class Maker:
    """A glTF document and its one buffer, put together accessor by accessor."""

    json: dict = field(default_factory=lambda: {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []})
    data: bytearray = field(default_factory=bytearray)

    def view(self, content: bytes, **extra: object) -> int:
        self.data += bytes(-len(self.data) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        self.json["bufferViews"].append(entry | extra)
        self.data += content
        return len(self.json["bufferViews"]) - 1

    def accessor(self, array: np.ndarray, **extra: object) -> int:
        """An accessor with a view of its own; extra overrides or adds members, None drops one."""
        array = np.atleast_2d(array.T).T
        entry = {"bufferView": None, "componentType": TYPES[array.dtype], "count": len(array),
                 "type": NAMES[array.shape[1]]}  # fmt: skip
        if "bufferView" not in extra:
            extra["bufferView"] = self.view(array.tobytes())
        entry |= extra
        self.json["accessors"].append({k: v for k, v in entry.items() if v is not None})
        return len(self.json["accessors"]) - 1

    def interleaved(self, **columns: np.ndarray) -> dict[str, int]:
        """Accessors that share one view with a byteStride."""
        parts = [np.ascontiguousarray(column).view("u1").reshape(len(column), -1) for column in columns.values()]
        rows = np.hstack(parts)
        rows = np.hstack([rows, np.zeros((len(rows), -rows.shape[1] % 4), "u1")])
        view = self.view(rows.tobytes(), byteStride=rows.shape[1])
        result, offset = {}, 0
        for (name, column), part in zip(columns.items(), parts):
            extra = {"normalized": True} if name.startswith("WEIGHTS") and column.dtype != "<f4" else {}
            result[name] = self.accessor(column, bufferView=view, byteOffset=offset, **extra)
            offset += part.shape[1]
        return result

    def sparse(self, array: np.ndarray, base: bool = True) -> int:
        """All elements through a sparse accessor, over zeros or over a base of other values."""
        indices = np.arange(len(array), dtype="<u2")
        extra = {"sparse": {
            "count": len(array),
            "indices": {"bufferView": self.view(indices.tobytes()), "componentType": 5123},
            "values": {"bufferView": self.view(array.tobytes())},
        }}  # fmt: skip
        if not base:
            extra["bufferView"] = None
        return self.accessor(np.zeros_like(array) if base else array, **extra)

    def alias(self, index: int) -> int:
        """One more accessor of the same bytes."""
        self.json["accessors"].append(dict(self.json["accessors"][index], name="the same bytes"))
        return len(self.json["accessors"]) - 1

    def glb(self) -> bytes:
        self.data += bytes(-len(self.data) % 4)
        self.json["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(self.data), len(text), b"JSON")
        return head + text + struct.pack("<I4s", len(self.data), b"BIN\0") + bytes(self.data)

    def write(self, path: Path, external: str | None = None) -> Path:
        """As .glb, as .gltf with a data URI, or with an external file of that name."""
        if path.suffix == ".glb":
            path.write_bytes(self.glb())
            return path
        buffer = {"byteLength": len(self.data)}
        if external is None:
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        else:
            buffer["uri"] = external.replace(" ", "%20")
            (path.parent / external).parent.mkdir(parents=True, exist_ok=True)
            (path.parent / external).write_bytes(self.data)
        self.json["buffers"] = [buffer]
        path.write_text(json.dumps(self.json, indent=1) + "\n")
        return path


SIDES, RINGS = 6, 5


@dataclass
class Tube:
    """A tube of SIDES x RINGS vertices along y over a chain of joints, and its attributes."""

    joint_count: int = 8
    seed: int = 1

    def __post_init__(self) -> None:
        around, up = np.meshgrid(np.arange(SIDES), np.arange(RINGS))
        angle = around.ravel() * 2 * np.pi / SIDES
        self.positions = np.stack([np.cos(angle), up.ravel(), np.sin(angle)], 1).astype("<f4")
        rng = np.random.default_rng(self.seed)
        self.joints = np.stack([rng.permutation(self.joint_count)[:4] for _ in self.positions]).astype("<u2")
        self.joints[0, 0] = self.joint_count - 1
        shares = rng.integers(1, 60, (len(self.positions), 4))
        shares[:, 0] = 255 - shares[:, 1:].sum(1)
        self.shares = shares.astype("u1")  # of 255
        self.weights = (shares / 255).astype("<f4")
        side = np.arange(SIDES)
        a = (np.arange(RINGS - 1)[:, None] * SIDES + side).ravel()
        b = (np.arange(RINGS - 1)[:, None] * SIDES + (side + 1) % SIDES).ravel()
        self.indices = np.stack([a, b, a + SIDES, b, b + SIDES, a + SIDES], 1).ravel().astype("<u2")

    def attributes(self, maker: Maker, **other: int) -> dict[str, int]:
        """POSITION, JOINTS_0, WEIGHTS_0 in views of their own, but for those given."""
        made = dict(other)
        if "POSITION" not in made:
            low, high = self.positions.min(0).tolist(), self.positions.max(0).tolist()
            made["POSITION"] = maker.accessor(self.positions, min=low, max=high)
        if "JOINTS_0" not in made:
            made["JOINTS_0"] = maker.accessor(self.joints)
        if "WEIGHTS_0" not in made:
            made["WEIGHTS_0"] = maker.accessor(self.weights)
        return made

    def twice(self, maker: Maker, first: dict) -> list[dict]:
        """A primitive, and a second one of some triangles of the same vertices."""
        return [first, {"attributes": first["attributes"], "indices": maker.accessor(self.indices[:30])}]

    def build(self, maker: Maker, primitives: list[dict], **mesh: object) -> Maker:
        """Nodes 0.. are the chain, the last one the skinned mesh."""
        nodes = [{"name": f"j{j}", "translation": [0, 0 if j == 0 else 1, 0]} for j in range(self.joint_count)]
        for j in range(self.joint_count - 1):
            nodes[j]["children"] = [j + 1]
        binds = np.tile(np.eye(4, dtype="<f4"), (self.joint_count, 1, 1))
        binds[:, 3, 1] = -np.arange(self.joint_count)
        skin = {"joints": list(range(self.joint_count)), "inverseBindMatrices": maker.accessor(binds.reshape(-1, 16))}
        nodes.append({"name": "body", "mesh": 0, "skin": 0})
        maker.json |= {"nodes": nodes, "skins": [skin], "scene": 0,
                       "scenes": [{"nodes": [0, self.joint_count]}],
                       "meshes": [{"primitives": primitives} | mesh]}  # fmt: skip
        return maker


def plain(**tube: int) -> Maker:
    """A tube with nothing awkward."""
    maker, shape = Maker(), Tube(**tube)
    primitive = {"attributes": shape.attributes(maker), "indices": maker.accessor(shape.indices)}
    return shape.build(maker, [primitive])
