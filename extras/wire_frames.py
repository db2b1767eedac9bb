#!/usr/bin/env python3
"""Writes frames as docs/wire.md says, without our code: the bytes that tests/wire.rs expects.

    python3 extras/wire_frames.py
"""

from math import floor, sqrt


class Bits:
    def __init__(self):
        self.bits = []

    def u(self, v, n):
        self.bits += [v >> i & 1 for i in range(n)]

    def g(self, v, k):
        q = (v >> k) + 1
        b = q.bit_length()
        self.u(0, b - 1)
        self.u(1, 1)
        self.u(q, b - 1)
        self.u(v, k)

    def v(self, v):
        self.g(v, 7)

    def z(self, v):
        self.v(zigzag(v))

    def c(self, values):
        if values:
            _, way, k = best(values)
            self.u(way, 1)
            self.u(k, 6)
            for v in values:
                self.g(v, k) if way else self.u(v, k)

    def s(self, values):
        if not values:
            return
        least = min(values)
        above = [v - least for v in values]
        steps = [zigzag(v - w) for v, w in zip(values, [0] + values)]
        steep = best(steps)[0] < best(above)[0] + golomb_length(zigzag(least), 7)
        self.u(int(steep), 1)
        if not steep:
            self.z(least)
        self.c(steps if steep else above)

    def bytes(self):
        b = self.bits + [0] * (-len(self.bits) % 8)
        return bytes(sum(b[i + j] << j for j in range(8)) for i in range(0, len(b), 8))


def zigzag(v):
    return 2 * v if v >= 0 else -2 * v - 1


def golomb_length(v, k):
    return 2 * ((v >> k) + 1).bit_length() - 1 + k


def best(values):
    """(bits, way, k) of the cheapest way: of equals fixed bits, then the smaller k."""
    fixed = max(values).bit_length()
    ways = [(len(values) * fixed, 0, fixed)] if fixed < 64 else []
    ways += [(sum(golomb_length(v, k) for v in values), 1, k) for k in range(64)]
    return min(ways)


def fnv(data):
    h = 0x811C9DC5
    for byte in data:
        h = (h ^ byte) * 0x01000193 & 0xFFFFFFFF
    return h


def gaps(places):
    return [b - a - 1 for a, b in zip([-1] + places, places)]


def rounded(x):
    return floor(x + 0.5) if x >= 0 else -floor(-x + 0.5)


def footprints(out, nodes):
    out.c([int("reach" in n) for n in nodes])
    there = [n for n in nodes if "reach" in n]
    out.c([n["yaw"] for n in there])
    for k in (0, 2):
        sides = [n["reach"][k] + n["reach"][k + 4] for n in there]
        out.c(sides)
        out.c([zigzag(n["reach"][k] - (a + 1) // 2) for n, a in zip(there, sides)])
    for k in (1, 3, 5, 7):
        out.c([rounded((n["reach"][k - 1] + n["reach"][(k + 1) % 8]) / sqrt(2)) - n["reach"][k] for n in there])


def looked(out, cell, origin, cells):
    low = [min(c[a] for c in cells) for a in range(3)]
    size = [max(c[a] for c in cells) - low[a] + 1 for a in range(3)]
    out.v(cell)
    out.s(origin)
    out.s(low)
    out.c(size)
    seen = {tuple(c[a] - low[a] for a in range(3)) for c in cells}
    was = lambda x, y, z: int((x, y, z) in seen)
    guesses = [
        lambda x, y, z: 0,
        lambda x, y, z: 1,
        lambda x, y, z: was(x - 1, y, z),
        lambda x, y, z: was(x, y - 1, z),
        lambda x, y, z: was(x, y, z - 1),
        lambda x, y, z: was(x - 1, y, z) ^ was(x, y - 1, z) ^ was(x - 1, y - 1, z),
        lambda x, y, z: was(x - 1, y, z) ^ was(x, y, z - 1) ^ was(x - 1, y, z - 1),
        lambda x, y, z: was(x, y - 1, z) ^ was(x, y, z - 1) ^ was(x, y - 1, z - 1),
    ]
    order = [(x, y, z) for z in range(size[2]) for y in range(size[1]) for x in range(size[0])]
    wrong = [[i for i, c in enumerate(order) if g(*c) != was(*c)] for g in guesses]
    k = min(range(8), key=lambda k: len(wrong[k]))
    out.u(k, 3)
    out.v(len(wrong[k]))
    out.c(gaps(wrong[k]))
    return size[0] * size[1] * size[2]


def frame(classes, predicates, o):
    nodes, edges = o["nodes"], o["edges"]
    words = b"".join(w.encode() + b"\0" for w in classes) + b"\1"
    words += b"".join(w.encode() + b"\0" for w in predicates) + b"\1"
    evidence = any(n["others"] or n["misses"] for n in nodes)
    flags = evidence + 2 * ("looked" in o) + 4 * any("reach" in n for n in nodes)
    out = Bits()
    for v in o["key"]:
        out.v(v)
    out.v(len(nodes))
    out.v(len(edges))
    ids = [n["id"] for n in nodes]
    if nodes:
        out.v(ids[0])
    out.c([b - a - 1 for a, b in zip(ids, ids[1:])])
    out.c([n["label"] for n in nodes])
    out.c([n["score"] for n in nodes])
    for a in range(3):
        out.s([n["centroid"][a] for n in nodes])
    for a in range(3):
        out.c([n["extent"][a] for n in nodes])
    out.c([n["sightings"] for n in nodes])
    out.s([n["ago"] for n in nodes])
    if flags & 4:
        footprints(out, nodes)
    if flags & 1:
        out.c([len(n["others"]) for n in nodes])
        others = [x for n in nodes for x in n["others"]]
        out.c([x[0] for x in others])
        out.c([x[1] for x in others])
        out.c([n["misses"] for n in nodes])
    ends = sorted((ids.index(s), ids.index(t), p, score) for s, t, p, score in edges)
    out.c([b[0] - a for a, b in zip([0] + [e[0] for e in ends], ends)])
    out.s([e[1] - e[0] for e in ends])
    out.c([e[2] for e in ends])
    out.c([e[3] for e in ends])
    cells = looked(out, *o["looked"]) if flags & 2 else 0
    data = b"MSG5" + bytes([flags]) + fnv(words).to_bytes(4, "little") + out.bytes()
    least = 9 + 10 * len(nodes) + 5 * sum("yaw" in n for n in nodes) + 2 * len(edges) + -(-cells // 64)
    return data + bytes(max(0, least - len(data)))


def node(id, label, centroid, extent, score, sightings, ago, others, misses, **footprint):
    return dict(id=id, label=label, centroid=centroid, extent=extent, score=score, sightings=sightings, ago=ago,
                others=others, misses=misses, **footprint)


def main():
    hidden = [(2, 1, 2), (2, 1, 3), (-1, 2, 3)]
    cells = [(k % 4 - 1, k // 4 % 3, k // 12 + 2) for k in range(24)]
    room = dict(
        key=[3, 1, 7, 100, 800, 2],
        nodes=[
            node(5, 0, [120, -400, 130], [400, 20, 260], 127, 1, 0, [], 0,
                 yaw=341, reach=[210, 150, 7, 139, 190, 137, 5, 140]),
            node(6, 1, [-35, 10, 45], [50, 55, 90], 64, 4, 25, [(2, 30), (0, 2)], 0),
            node(900, 2, [250, 12, -1], [20, 21, 30], 3, 1, 799, [(1, 60)], 3),
        ],
        edges=[(6, 5, 0, 100), (900, 6, 1, 127)],
        looked=(50, [10, -20, 0], [c for c in cells if c not in hidden]),
    )
    seen = [True, True, False, True, False, True]
    rows = dict(
        key=[0, 0, 1, 0, 10, 0],
        nodes=[],
        edges=[],
        looked=(50, [0, 0, 0], [(k % 6, k // 6 % 4, k // 24) for k in range(48) if seen[k % 6]]),
    )
    for o in (room, rows):
        print(frame(["wall", "chair", "lamp"], ["on", "near"], o).hex())


if __name__ == "__main__":
    main()
