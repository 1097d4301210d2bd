"""Models for the tests: bumpy spheres, each with a shape of its own, as binary glTF."""

import json
import math
import struct


def sphere(rings, bumps):
    """The bytes of a sphere of `2 * rings * rings` triangles."""
    step = math.pi / rings
    positions = []
    for i in range(rings + 1):
        for j in range(rings):
            theta, phi = i * step, 2 * j * step
            # The factor tells spheres apart whose bumps fall on the same vertices.
            radius = (1 + 0.1 * math.sin(5 * theta) * math.cos(bumps * phi)) * (1 + 1e-4 * bumps)
            positions.append((radius * math.sin(theta) * math.cos(phi), radius * math.cos(theta),
                              radius * math.sin(theta) * math.sin(phi)))
    indices = []
    for i in range(rings):
        for j in range(rings):
            a, b, c, d = (k * rings + l % rings for k in (i, i + 1) for l in (j, j + 1))
            indices += [a, b, c, b, d, c]
    data = b"".join(struct.pack("<3f", *p) for p in positions)
    split = len(data)
    data += b"".join(struct.pack("<I", i) for i in indices)
    bounds = [[f(p[k] for p in positions) for k in range(3)] for f in (min, max)]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": split},
                        {"buffer": 0, "byteOffset": split, "byteLength": len(data) - split}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(positions),
                       "min": bounds[0], "max": bounds[1]},
                      {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": len(indices)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def library(folder, number):
    """Writes `number` models, three in a folder."""
    for n in range(number):
        path = folder / f"kit{n // 3:02}" / f"model{n:03}.glb"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(sphere(12 + n % 3, n + 1))
