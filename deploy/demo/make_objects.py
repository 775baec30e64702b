#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the demo's CG objects, amphora.glb, sculpture.glb, table.glb, ball.glb and pinwheel.glb, beside this file (or in the folder given).

Everything is computed: the same bytes on every run. y up, metres, standing on y = 0 about the y axis.
Needs only Python's own library.
"""
import json
import math
import pathlib
import struct
import sys
import zlib


# ---- pictures -------------------------------------------------------------------------------------------------

def png(width, height, colour_at, samples=2):
    """PNG bytes of colour_at(u, v) -> (r, g, b) in 0..255, each pixel the mean of samples x samples points."""
    rows = bytearray()
    steps = [(k + 0.5) / samples for k in range(samples)]
    for y in range(height):
        rows.append(0)
        for x in range(width):
            total = [0.0, 0.0, 0.0]
            for j in steps:
                for i in steps:
                    colour = colour_at((x + i) / width, (y + j) / height)
                    for c in range(3):
                        total[c] += colour[c]
            # Five bits a channel: nobody sees the steps, and the file is a third of the size.
            rows.extend(min(255, int(t / len(steps) ** 2 / 8 + 0.5) * 8) for t in total)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(rows), 9)) +
            chunk(b"IEND", b""))


def hash01(x, y, seed):
    """A number in 0..1 for a lattice point, the same everywhere."""
    h = (x * 374761393 + y * 668265263 + seed * 974634777) & 0xFFFFFFFF
    h = (h ^ (h >> 13)) * 1274126177 & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65535.0


def noise(u, v, period, seed):
    """Smooth noise that repeats at 0..1 in u and v; period: cells a side."""
    x, y = u * period, v * period
    ix, iy = math.floor(x), math.floor(y)
    fx, fy = x - ix, y - iy
    sx, sy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    corner = [[hash01((ix + i) % period, (iy + j) % period, seed) for i in (0, 1)] for j in (0, 1)]
    top = corner[0][0] + sx * (corner[0][1] - corner[0][0])
    bottom = corner[1][0] + sx * (corner[1][1] - corner[1][0])
    return top + sy * (bottom - top)


def mix(a, b, t):
    t = min(1.0, max(0.0, t))
    return tuple(p + (q - p) * t for p, q in zip(a, b))


CLAY, BLACK, CREAM, OXIDE = (204, 120, 66), (40, 32, 32), (236, 214, 170), (150, 62, 40)
KEY = ("1111111", "1000001", "1011101", "1010001", "1011111", "1000000", "1111111")


def amphora_paint(u, v):
    """Bands around the pot; v = 0 at the lip, 1 at the foot."""
    if v < 0.07 or v > 0.95:
        return BLACK
    if v < 0.22:  # tongues on the neck
        x = (u * 24) % 1 - 0.5
        return BLACK if abs(x) < 0.32 * math.sqrt(max(0.0, (0.21 - v) / 0.13)) else CLAY
    if v < 0.24 or 0.36 < v < 0.38 or 0.66 < v < 0.68 or 0.79 < v < 0.81:
        return CREAM
    if v < 0.36:  # Greek key
        row = min(6, int((v - 0.24) / 0.12 * 9) - 1)
        column = int(u * 16 * 7) % 7
        return BLACK if 0 <= row and KEY[row][column] == "1" else CLAY
    if v < 0.66:  # suns
        x, y = ((u * 6) % 1 - 0.5) * 0.20, v - 0.52
        r, angle = math.hypot(x, y), math.atan2(y, x)
        if r < 0.022:
            return CREAM
        if r < 0.045:
            return OXIDE
        if r < 0.048 + 0.045 * abs(math.cos(6 * angle)) ** 0.7:
            return BLACK
        return CLAY if 0.11 > abs(y) else OXIDE
    if v < 0.79:  # running waves
        x = 2 * math.pi * 16 * u
        return BLACK if v - 0.735 > 0.035 * math.sin(x + 1.1 * math.sin(x)) else CLAY
    x = abs((u * 20) % 1 - 0.5)  # rays
    return BLACK if x < 0.5 * (v - 0.81) / 0.14 else CLAY


def marble_paint(u, v):
    turbulence = sum(noise(u, v, 3 << k, k) / (1 << k) for k in range(4))
    vein = abs(math.sin(math.pi * (2 * u + 2 * v + 1.6 * turbulence)))
    return mix((150, 146, 148), (232, 228, 220), vein ** 0.45)


def slate_paint(u, v):
    turbulence = sum(noise(u, v, 4 << k, 9 + k) / (1 << k) for k in range(3))
    vein = abs(math.sin(math.pi * (3 * u - 2 * v + 1.4 * turbulence)))
    return mix((150, 150, 160), (60, 62, 72), vein ** 0.25)


def ribbon_paint(u, v):
    """Stripes that wind once around the tube; u along it, v around."""
    s = (4 * v + 12 * u) % 1
    if s < 0.10 or 0.40 < s < 0.50:
        return (240, 208, 130)
    return mix((16, 108, 116), (40, 168, 160), 0.5 + 0.5 * math.sin(2 * math.pi * (24 * u))) if s < 0.40 else (196, 72, 52)


def oak_paint(u, v):
    """Grain along u."""
    grain = sum(noise(u, v, 2 << k, 21 + k) / (1 << k) for k in range(2))
    ring = 0.5 + 0.5 * math.sin(2 * math.pi * (9 * v + 0.8 * grain))
    return mix((122, 74, 40), (174, 116, 68), 0.25 + 0.5 * ring * ring + 0.25 * noise(u, v, 48, 5))


def ball_paint(u, v):
    """Six gores with white seams, a cap at either end."""
    if v < 0.07 or v > 0.93:
        return (244, 240, 230)
    gore = u * 6
    if abs(gore - round(gore)) < 0.05:
        return (244, 240, 230)
    return ((226, 74, 44), (248, 186, 52), (34, 118, 184))[int(gore) % 3]


def sail_paint(u, v):
    """A sail from its hub (u = 0) to its tip, with a hem."""
    if u > 0.93 or v < 0.06 or v > 0.94:
        return (250, 246, 236)
    return mix((214, 58, 40), (250, 178, 44), u)


def pine_paint(u, v):
    return mix((196, 158, 104), (222, 188, 134), noise(u, v, 16, 31))


# ---- shapes ---------------------------------------------------------------------------------------------------

class Part:
    """Triangles of one material."""

    def __init__(self):
        self.positions, self.normals, self.uvs, self.indices = [], [], [], []

    def vertex(self, position, normal, uv):
        self.positions.append(position)
        self.normals.append(normalised(normal))
        self.uvs.append(uv)
        return len(self.positions) - 1

    def triangle(self, a, b, c):
        """Wound so that the corners' normals point out of its front."""
        pa, pb, pc = (self.positions[i] for i in (a, b, c))
        face = cross(minus(pb, pa), minus(pc, pa))
        if dot(face, face) < 1e-18:
            return
        outward = [sum(self.normals[i][k] for i in (a, b, c)) for k in range(3)]
        self.indices += [a, b, c] if dot(face, outward) > 0 else [a, c, b]

    def grid(self, rows):
        for above, below in zip(rows, rows[1:]):
            for k in range(len(above) - 1):
                self.triangle(above[k], below[k], above[k + 1])
                self.triangle(above[k + 1], below[k], below[k + 1])


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def normalised(a):
    length = math.sqrt(dot(a, a)) or 1.0
    return tuple(x / length for x in a)


def smooth_profile(points, count):
    """A Catmull-Rom curve through the points, at count places."""
    out = []
    for i in range(count):
        s = i * (len(points) - 1) / (count - 1)
        k = min(int(s), len(points) - 2)
        t = s - k
        p = [points[min(max(k + j, 0), len(points) - 1)] for j in (-1, 0, 1, 2)]
        out.append(tuple(0.5 * (2 * p[1][c] + (p[2][c] - p[0][c]) * t +
                                (2 * p[0][c] - 5 * p[1][c] + 4 * p[2][c] - p[3][c]) * t * t +
                                (3 * p[1][c] - p[0][c] - 3 * p[2][c] + p[3][c]) * t ** 3) for c in (0, 1)))
    return out


def lathe(part, profile, segments, v_of):
    """Turns a profile of (radius, y), listed with the outside to its left seen going up."""
    rows = []
    for i, (radius, y) in enumerate(profile):
        before, after = profile[max(i - 1, 0)], profile[min(i + 1, len(profile) - 1)]
        out_r, out_y = after[1] - before[1], before[0] - after[0]
        row = []
        for k in range(segments + 1):
            a = 2 * math.pi * k / segments
            c, s = math.cos(a), math.sin(a)
            row.append(part.vertex((radius * c, y, radius * s), (out_r * c, out_y, out_r * s), (k / segments, v_of(i, y))))
        rows.append(row)
    part.grid(rows)


def tube(part, path, radius, around, uv_of, closed):
    """A round tube along (position, tangent, reference normal)."""
    rows = []
    count = len(path)
    for i in range(count + (1 if closed else 0)):
        centre, tangent, reference = path[i % count]
        b = normalised(cross(tangent, reference))
        n = cross(b, normalised(tangent))
        row = []
        for k in range(around + 1):
            a = 2 * math.pi * k / around
            out = tuple(math.cos(a) * n[c] + math.sin(a) * b[c] for c in range(3))
            row.append(part.vertex(tuple(centre[c] + radius * out[c] for c in range(3)), out, uv_of(i / count, k / around)))
        rows.append(row)
    part.grid(rows)


def square_column(part, profile, metres_per_texture):
    """A column of square section from (half width, y) upwards; flat faces, closed on top."""
    for (w0, y0), (w1, y1) in zip(profile, profile[1:]):
        for side in range(4):
            c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[side]
            normal = (c * (y1 - y0), w0 - w1, s * (y1 - y0))
            corners = []
            for w, y in ((w0, y0), (w1, y1)):
                for e in (-1, 1):
                    position = (c * w - s * e * w, y, s * w + c * e * w)
                    along = e * w + 0.37 * side
                    rise = y + (w0 - w if y0 == y1 else 0)
                    corners.append(part.vertex(position, normal, (along / metres_per_texture, -rise / metres_per_texture)))
            part.triangle(corners[0], corners[1], corners[2])
            part.triangle(corners[2], corners[1], corners[3])
    w, y = profile[-1]
    top = [part.vertex((x * w, y, z * w), (0, 1, 0), (x * w / metres_per_texture, z * w / metres_per_texture))
           for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    part.triangle(top[0], top[1], top[2])
    part.triangle(top[0], top[2], top[3])


def column_profile(half, height):
    """Base plate, shaft and cap with small bevels."""
    b, base, cap = 0.006, half * 1.22, half * 1.15
    return [(base - b, 0.0), (base, b), (base, 0.05 - b), (base - b, 0.05), (half + b, 0.05), (half, 0.056),
            (half, height - 0.046), (half + b, height - 0.04), (cap - b, height - 0.04), (cap, height - 0.04 + b),
            (cap, height - b), (cap - b, height)]


# ---- objects --------------------------------------------------------------------------------------------------

def amphora():
    stand = 0.70
    column = Part()
    square_column(column, column_profile(0.15, stand), 0.5)
    outside = smooth_profile([(0.066, 0.0), (0.070, 0.012), (0.046, 0.030), (0.062, 0.070), (0.118, 0.170), (0.150, 0.270),
                              (0.146, 0.350), (0.104, 0.420), (0.066, 0.455), (0.056, 0.500), (0.060, 0.545), (0.084, 0.566),
                              (0.086, 0.578)], 44)
    inside = [(0.078, 0.581), (0.064, 0.566), (0.046, 0.530), (0.044, 0.480), (0.060, 0.440), (0.090, 0.400)]
    height = 0.578
    pot = Part()
    lathe(pot, [(r, stand + y) for r, y in outside], 44, lambda i, y: 1 - (y - stand) / height)
    lathe(pot, [(r, stand + y) for r, y in [outside[-1]] + inside], 44, lambda i, y: 0.03)
    for side in (-1, 1):
        a, b, c, d = (0.058, 0.535), (0.190, 0.580), (0.185, 0.440), (0.125, 0.390)
        path = []
        for i in range(13):
            t = i / 12
            w = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t ** 3)
            g = (3 * (1 - t) ** 2, 6 * t * (1 - t), 3 * t * t)
            x, y = (sum(k * p[n] for k, p in zip(w, (a, b, c, d))) for n in (0, 1))
            dx, dy = (g[0] * (b[n] - a[n]) + g[1] * (c[n] - b[n]) + g[2] * (d[n] - c[n]) for n in (0, 1))
            path.append(((side * x, stand + y, 0.0), (side * dx, dy, 0.0), (0.0, 0.0, 1.0)))
        tube(pot, path, 0.0125, 8, lambda s, t: (0.5, 0.03), closed=False)
    return [(column, "marble", png(128, 128, marble_paint), 0.0, 0.55), (pot, "pottery", png(448, 448, amphora_paint), 0.0, 0.35)]


def sculpture():
    stand = 0.78
    column = Part()
    square_column(column, column_profile(0.14, stand), 0.6)
    knot = Part()
    count, ring, loop, thick = 132, 0.150, 0.068, 0.042
    path = []

    def at(t):
        r = ring + loop * math.cos(3 * t)
        return (r * math.sin(2 * t), r * math.cos(2 * t), loop * math.sin(3 * t))

    for i in range(count):
        t = 2 * math.pi * i / count
        tangent = minus(at(t + 1e-4), at(t - 1e-4))
        core = (ring * math.sin(2 * t), ring * math.cos(2 * t), 0.0)
        path.append((at(t), tangent, minus(at(t), core)))
    lowest = min(p[0][1] for p in path) - thick
    path = [((x, y - lowest + stand - 0.004, z), tangent, n) for (x, y, z), tangent, n in path]
    tube(knot, path, thick, 12, lambda s, t: (s, t), closed=True)
    return [(column, "slate", png(128, 128, slate_paint), 0.0, 0.5), (knot, "enamel", png(512, 64, ribbon_paint), 0.0, 0.25)]


def table():
    """A small round one on a turned foot."""
    top, height = 0.21, 0.66
    wood = Part()
    foot = smooth_profile([(0.158, 0.014), (0.120, 0.030), (0.040, 0.075), (0.026, 0.16), (0.030, 0.34), (0.040, 0.40), (0.026, 0.46),
                           (0.030, height - 0.05), (0.062, height - 0.026)], 28)
    edge = [(top - 0.006, height - 0.026), (top, height - 0.020), (top, height - 0.006), (top - 0.006, height)]
    lathe(wood, [(0.152, 0.0), (0.158, 0.004)] + foot, 36, lambda i, y: 1.2 * y)
    lathe(wood, [(0.062, height - 0.026)] + edge, 36, lambda i, y: 0.1 * i)
    middle = wood.vertex((0.0, height, 0.0), (0.0, 1.0, 0.0), (0.5, 0.5))
    rim = []
    for k in range(37):
        a = 2 * math.pi * k / 36
        x, z = (top - 0.006) * math.cos(a), (top - 0.006) * math.sin(a)
        rim.append(wood.vertex((x, height, z), (0.0, 1.0, 0.0), (0.5 + x, 0.5 + z)))
    for a, b in zip(rim, rim[1:]):
        wood.triangle(middle, a, b)
    return [(wood, "oak", png(192, 192, oak_paint), 0.0, 0.4)]


def ball():
    radius, rings = 0.11, 24
    skin = Part()
    profile = [(radius * math.sin(math.pi * i / rings), radius - radius * math.cos(math.pi * i / rings)) for i in range(rings + 1)]
    lathe(skin, profile, 36, lambda i, y: i / rings)
    return [(skin, "rubber", png(240, 96, ball_paint), 0.0, 0.3)]


def pinwheel():
    """Six sails that turn on a stand: "turn" for ever, "gust" once round and round until it is still."""
    stand, hub_y, radius = Part(), 0.80, 0.23
    lathe(stand, [(0.0, 0.020), (0.100, 0.020), (0.110, 0.014), (0.110, 0.0)][::-1], 28, lambda i, y: 0.1 * i)
    lathe(stand, [(0.012, 0.018), (0.009, hub_y), (0.0, hub_y + 0.006)], 12, lambda i, y: y)
    wheel = Part()
    for sail in range(6):
        for side in (1, -1):
            rows = []
            for i in range(7):
                row = []
                for j in range(5):
                    s, t = i / 6, j / 4
                    a = 2 * math.pi * sail / 6 + 0.80 * t
                    r = 0.018 + (radius - 0.018) * s * (1 - 0.35 * t)
                    belly = 0.055 * s * t * t  # the trailing edge is bent toward whom it faces
                    normal = (-0.6 * t * s * -math.sin(a) * side, -0.6 * t * s * math.cos(a) * side, side)
                    row.append(wheel.vertex((r * math.cos(a), r * math.sin(a), 0.03 + belly + 0.001 * side), normal, (s, t)))
                rows.append(row)
            wheel.grid(rows)
    hub = Part()
    lathe(hub, [(0.0, 0.050), (0.016, 0.046), (0.022, 0.032), (0.016, 0.006)][::-1], 16, lambda i, y: 0.5)
    hub.positions = [(x, -z, y) for x, y, z in hub.positions]  # its axis forward
    hub.normals = [(x, -z, y) for x, y, z in hub.normals]
    cream = png(4, 4, lambda u, v: (244, 232, 206))
    parts = [(stand, "pine", png(64, 64, pine_paint), 0.0, 0.6)]
    turning = [(wheel, "paper", png(96, 64, sail_paint), 0.0, 0.5), (hub, "enamel", cream, 0.0, 0.3)]
    # Slower and slower, through whole turns: 12 thirds of one.
    slowing = [(4.0 * (1 - (1 - k / 12) ** 0.5), k) for k in range(13)]
    return parts, Turning((0.0, hub_y, 0.0), turning, {
        "turn": [(k * 5.0 / 3, k) for k in range(4)],
        "gust": slowing,
    })


class Turning:
    """Parts that turn about z of a pivot: clips of (second, thirds of a turn)."""

    def __init__(self, pivot, parts, clips):
        self.pivot, self.parts, self.clips = pivot, parts, clips


# ---- glTF -----------------------------------------------------------------------------------------------------

def write_glb(path, parts, turning=None):
    views, accessors, materials, images, animations = [], [], [], [], []
    binary = bytearray()

    def view(data):
        binary.extend(b"\0" * (-len(binary) % 4))
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        binary.extend(data)
        return len(views) - 1

    def accessor(data, component, count, kind, **extra):
        accessors.append({"bufferView": view(data), "componentType": component, "count": count, "type": kind, **extra})
        return len(accessors) - 1

    def floats(rows):
        flat = [x for row in rows for x in row]
        return struct.pack("<%df" % len(flat), *flat)

    def single(values):
        return list(struct.unpack("<%df" % len(values), struct.pack("<%df" % len(values), *values)))

    def primitive(part, name, picture, metallic, roughness):
        count = len(part.positions)
        assert count < 65536
        low = [min(p[k] for p in part.positions) for k in range(3)]
        high = [max(p[k] for p in part.positions) for k in range(3)]
        attributes = {
            "POSITION": accessor(floats(part.positions), 5126, count, "VEC3", min=single(low), max=single(high)),
            "NORMAL": accessor(floats(part.normals), 5126, count, "VEC3"),
            "TEXCOORD_0": accessor(floats(part.uvs), 5126, count, "VEC2"),
        }
        indices = accessor(struct.pack("<%dH" % len(part.indices), *part.indices), 5123, len(part.indices), "SCALAR")
        images.append({"bufferView": view(picture), "mimeType": "image/png"})
        materials.append({"name": name, "pbrMetallicRoughness": {
            "baseColorTexture": {"index": len(images) - 1}, "metallicFactor": metallic, "roughnessFactor": roughness}})
        return {"attributes": attributes, "indices": indices, "material": len(materials) - 1}

    meshes = [{"primitives": [primitive(*part) for part in parts]}]
    nodes = [{"mesh": 0, "name": path.stem}]
    if turning is not None:
        meshes.append({"primitives": [primitive(*part) for part in turning.parts]})
        nodes[0]["children"] = [1]
        nodes.append({"mesh": 1, "name": "wheel", "translation": list(turning.pivot)})
        for name, keys in turning.clips.items():
            times = [(t,) for t, _ in keys]
            half = [math.pi * thirds / 3 for _, thirds in keys]
            sampler = {
                "input": accessor(floats(times), 5126, len(keys), "SCALAR", min=single(times[0]), max=single(times[-1])),
                "output": accessor(floats([(0.0, 0.0, math.sin(a), math.cos(a)) for a in half]), 5126, len(keys), "VEC4"),
            }
            animations.append({"name": name, "samplers": [sampler],
                               "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}]})
    binary.extend(b"\0" * (-len(binary) % 4))
    document = {
        "asset": {"version": "2.0", "generator": "MixStage deploy/demo/make_objects.py"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "meshes": meshes, "materials": materials,
        "textures": [{"source": i} for i in range(len(images))], "images": images,
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }
    if animations:
        document["animations"] = animations
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + bytes(binary)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    triangles = sum(len(part.indices) // 3 for part, *_ in parts + (turning.parts if turning else []))
    print(f"{path.name}: {path.stat().st_size} bytes, {triangles} triangles")


def main():
    folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
    folder = folder if folder.is_dir() else folder.parent
    write_glb(folder / "amphora.glb", amphora())
    write_glb(folder / "sculpture.glb", sculpture())
    write_glb(folder / "table.glb", table())
    write_glb(folder / "ball.glb", ball())
    write_glb(folder / "pinwheel.glb", *pinwheel())


if __name__ == "__main__":
    main()
