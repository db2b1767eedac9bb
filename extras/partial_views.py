"""Two cropped views of each room of a generated data set, aligned with each other and with those of other rooms.

ma3dsg synth --rooms 24 --split train --seed 900 --no-rescans -o DATA
python3 extras/partial_views.py MA3DSG DATA WORK [CROSS] [SEED]     needs numpy

A view is half of a visit, every other frame of it, and of each image a part: the left of one, the right of the other, of
every second pair also the upper or lower three quarters. The second view is turned about the vertical and shifted. Its graph
is written to WORK, as scanned (`named`) and with the classes of four nodes in five lost or drawn anew (`lost`). Prints how
many poses are right (5 degrees, 0.15 m), wrong or refused, and how many of CROSS pairs of different rooms are matched.
"""
import json
import math
import os
import random
import subprocess
import sys
import zipfile

import numpy as np

CLASSES = (
    "cabinet bed chair sofa table door window bookshelf picture counter desk curtain refridgerator toilet sink bathtub "
    "otherfurniture wall floor"
).split()


def motion(yaw, shift):
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0, shift[0]], [s, c, 0, shift[1]], [0, 0, 1, shift[2]], [0, 0, 0, 1]])


def cropped(image, window):
    """A PGM of 16 bits without what lies outside the window (left, right, top, bottom as shares)."""
    header = image.split(b"\n", 3)
    width, height = map(int, header[1].split()[:2])
    start = len(image) - 2 * width * height
    depth = np.frombuffer(image[start:], dtype=">u2").reshape(height, width).copy()
    keep = np.zeros_like(depth)
    x0, x1, y0, y1 = window
    keep[int(y0 * height) : int(y1 * height), int(x0 * width) : int(x1 * width)] = 1
    return image[:start] + (depth * keep).astype(">u2").tobytes()


def view(program, visit, frames, turn, window, out):
    """Scans some frames of a visit; gives the graph."""
    os.makedirs(out, exist_ok=True)
    info = visit.read("_info.txt").decode().splitlines()
    info = [f"m_frames.size = {len(frames)}" if line.startswith("m_frames.size") else line for line in info]
    with zipfile.ZipFile(out + "/sequence.zip", "w") as archive:
        archive.writestr("_info.txt", "\n".join(info) + "\n")
        for k, f in enumerate(frames):
            archive.writestr(f"frame-{k:06d}.depth.pgm", cropped(visit.read(f"frame-{f:06d}.depth.pgm"), window))
            pose = np.array(visit.read(f"frame-{f:06d}.pose.txt").split(), dtype=float).reshape(4, 4)
            rows = (" ".join(f"{v:.9g}" for v in row) for row in turn @ pose)
            archive.writestr(f"frame-{k:06d}.pose.txt", "\n".join(rows) + "\n")
    subprocess.run([program, "scan", out, "-o", out, "--format", "3rscan"], check=True, capture_output=True)
    os.remove(out + "/sequence.zip")
    return json.load(open(out + "/graph.json"))


def lost(graph, dice):
    nodes = []
    for n in graph["nodes"] + graph.get("landmarks", []):
        if dice.random() < 0.8:
            label = dice.choice(CLASSES) if dice.random() < 0.4 else "none"
            n = {k: v for k, v in n.items() if k != "others"} | {"label": label, "score": dice.uniform(0.35, 0.9)}
        nodes.append(n)
    named = [n for n in nodes if n["label"] != "none"]
    return graph | {"nodes": named, "landmarks": [n for n in nodes if n["label"] == "none"], "edges": []}


def merged(program, a, b):
    said = subprocess.run([program, "merge", a, b, "--json"], check=True, capture_output=True)
    return json.loads(said.stdout)["merges"][0]["merge"]


def main(program, data, work, cross="2000", seed="5"):
    rng, dice = np.random.default_rng(int(seed)), random.Random(int(seed))
    pairs = []
    for room in sorted(d for d in os.listdir(data) if os.path.isdir(f"{data}/{d}")):
        visit = zipfile.ZipFile(f"{data}/{room}/sequence.zip")
        n = sum(name.endswith("depth.pgm") for name in visit.namelist())
        for k, later in enumerate((0.02, 0.12)):
            first, half = int(rng.integers(0, n // 5 + 1)), n // 2
            second = first + int(later * n)
            turn = motion(rng.uniform(0, 2 * math.pi), [*rng.uniform(-5, 5, 2), rng.uniform(-1, 1)])
            left, right = rng.uniform(0.5, 0.65, 2)
            high, low = ((0, 0.75), (0.2, 1)) if rng.random() < 0.5 else ((0, 1), (0, 1))
            home = f"{work}/{room}-{k}"
            windows = (0, left, *high), (1 - right, 1, *low)
            spans = range(first, first + half), range(second, min(n, second + half))
            odd = [[f for f in s if f % 2 == i] for i, s in enumerate(spans)]
            turns = np.eye(4), turn
            graphs = [view(program, visit, odd[i], turns[i], windows[i], f"{home}/{i}") for i in range(2)]
            wa, wb = (np.array(g.get("world_from_recording", np.eye(4))).reshape(4, 4) for g in graphs)
            for kind in "named", "lost":
                for i, g in enumerate(graphs):
                    json.dump(lost(g, dice) if kind == "lost" else g, open(f"{home}/{kind}-{i}.json", "w"))
            pairs.append((room, home, wa @ np.linalg.inv(turn) @ np.linalg.inv(wb), graphs[0]))
    for kind in "named", "lost":
        counts = {}
        for _, home, truth, a in pairs:
            m = merged(program, f"{home}/{kind}-0.json", f"{home}/{kind}-1.json")
            answer = m["outcome"] if m["outcome"] != "match" else None
            if answer is None:
                found = np.array(m["T_a_b"]).reshape(4, 4)
                middle = np.append(np.mean([n["centroid"] for n in a["nodes"] + a.get("landmarks", [])], axis=0), 1)
                shift = np.linalg.norm((found @ np.linalg.inv(truth) @ middle - middle)[:3])
                off = np.linalg.inv(truth) @ found
                turned = abs(math.degrees(math.atan2(off[1, 0], off[0, 0])))
                answer = "right" if shift < 0.15 and turned < 5 else "wrong"
                if answer == "wrong":
                    print(f"{kind} {home}: off by {shift:.2f} m and {turned:.1f} degrees, score {m['score']:.1f}")
            counts[answer] = counts.get(answer, 0) + 1
        print(kind, counts)
        matched = tried = 0
        while tried < int(cross):
            (room, home, _, _), (other, there, _, _) = dice.sample(pairs, 2)
            if room != other:
                tried += 1
                a, b = f"{home}/{kind}-{dice.randrange(2)}.json", f"{there}/{kind}-{dice.randrange(2)}.json"
                matched += merged(program, a, b)["outcome"] != "no_match"
        print(kind, f"{matched} of {tried} pairs of different rooms not refused")


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
