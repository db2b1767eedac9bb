"""Two robots in one real room: 20 runs, each 100 consecutive frames of two passes, the second pass turned about the true
vertical and shifted; scanned, then merged. Prints how many poses are right (5 degrees, 0.15 m at the middle of the graph),
wrong or refused, and the same with oracle labels: one label per pair of segments whose boxes overlap (IoU > 0.1) under
the true pose, a label of its own for every other one.

python3 extras/two_robots.py MA3DSG PASS_A PASS_B X,Y,Z [SEED]     X,Y,Z: up in the passes' frame; needs numpy
"""
import glob
import json
import math
import os
import subprocess
import sys
import tempfile

import numpy as np

RUNS, FRAMES = 20, 100


def rotation(axis, angle):
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def scan(program, folder, start, motion, out):
    """Links a stretch of a pass with moved poses, scans it, and gives its graph file."""
    os.makedirs(out)
    os.symlink(os.path.join(folder, "camera-intrinsics.txt"), os.path.join(out, "camera-intrinsics.txt"))
    for depth in sorted(glob.glob(folder + "/*.depth.png"))[start : start + FRAMES]:
        os.symlink(depth, os.path.join(out, os.path.basename(depth)))
        pose = depth.replace("depth.png", "pose.txt")
        np.savetxt(os.path.join(out, os.path.basename(pose)), motion @ np.loadtxt(pose), fmt="%.9g")
    subprocess.run([program, "scan", out, "-o", out + "-out"], check=True, capture_output=True)
    path = out + "-out/graph.json"
    return path, json.load(open(path))


def box(n, t=np.eye(4)):
    c = (t @ np.append(n["centroid"], 1))[:3]
    half = np.maximum(np.abs(t[:3, :3]) @ np.array(n["extent"]), 0.02) / 2
    return c - half, c + half


def iou(a, b):
    shared = np.prod(np.clip(np.minimum(a[1], b[1]) - np.maximum(a[0], b[0]), 0, None))
    return shared / (np.prod(a[1] - a[0]) + np.prod(b[1] - b[0]) - shared)


def oracle(a, b, a_from_b):
    """Both graphs under labels that tell corresponding segments, and their number."""
    na, nb = (g["nodes"] + g["landmarks"] for g in (a, b))
    boxes = [box(n) for n in na], [box(n, a_from_b) for n in nb]
    pairs = sorted(
        (-o, i, j) for i, x in enumerate(boxes[0]) for j, y in enumerate(boxes[1]) if (o := iou(x, y)) > 0.1
    )
    of_a, of_b = {}, {}
    for _, i, j in pairs:
        if i not in of_a and j not in of_b:
            of_a[i], of_b[j] = j, i

    def graph(nodes, label):
        keep = ("id", "centroid", "extent", "footprint")
        nodes = [{k: n[k] for k in keep if k in n} | {"label": label(k), "score": 0.95} for k, n in enumerate(nodes)]
        return {"schema": "ma3dsg-graph/1", "nodes": nodes, "edges": [], "gravity_aligned": True}

    return graph(na, lambda i: f"k{i}"), graph(nb, lambda j: f"k{of_b[j]}" if j in of_b else f"u{j}"), len(of_a)


def judge(found, truth, middle):
    if found is None:
        return "refused"
    off = np.linalg.inv(truth) @ found
    shift = np.linalg.norm((found @ np.linalg.inv(truth) @ middle - middle)[:3])
    angle = math.degrees(math.acos(max(-1, min(1, (np.trace(off[:3, :3]) - 1) / 2))))
    return "right" if shift < 0.15 and angle < 5 else f"wrong by {shift:.2f} m, {angle:.1f} degrees"


def main(program, pass_a, pass_b, up, seed="7"):
    up = np.array([float(v) for v in up.split(",")])
    up /= np.linalg.norm(up)
    rng = np.random.default_rng(int(seed))
    counts, ideal, common = {}, {}, []
    for _ in range(RUNS):
        with tempfile.TemporaryDirectory() as home:
            motion = np.eye(4)
            starts = [rng.integers(0, len(glob.glob(p + "/*.depth.png")) - FRAMES + 1) for p in (pass_a, pass_b)]
            motion[:3, :3] = rotation(up, rng.uniform(0, 2 * math.pi))
            motion[:3, 3] = rng.uniform(-5, 5, 3)
            path_a, a = scan(program, pass_a, starts[0], np.eye(4), home + "/a")
            path_b, b = scan(program, pass_b, starts[1], motion, home + "/b")
            wa, wb = (np.array(g["world_from_recording"]).reshape(4, 4) for g in (a, b))
            truth = wa @ np.linalg.inv(motion) @ np.linalg.inv(wb)
            middle = np.append(np.mean([n["centroid"] for n in a["nodes"] + a["landmarks"]], axis=0), 1)
            said = subprocess.run([program, "merge", path_a, path_b, "--json"], check=True, capture_output=True)
            m = json.loads(said.stdout)["merges"][0]["merge"]
            found = np.array(m["T_a_b"]).reshape(4, 4) if m["outcome"] == "match" else None
            answer = judge(found, truth, middle)
            counts[answer] = counts.get(answer, 0) + 1
            ga, gb, n = oracle(a, b, truth)
            common.append(n)
            for name, g in (("oa", ga), ("ob", gb)):
                json.dump(g, open(f"{home}/{name}.json", "w"))
            subprocess.run(
                [program, "align", home + "/ob.json", home + "/oa.json", "--json", home + "/o.json"],
                check=True,
                capture_output=True,
            )
            o = json.load(open(home + "/o.json"))
            found = np.array(o["T_ref_query"]).reshape(4, 4) if o["outcome"] == "match" else None
            answer = judge(found, truth, middle)
            ideal[answer] = ideal.get(answer, 0) + 1
    print("merge", counts)
    print("oracle labels", ideal, f"segments in common {min(common)} to {max(common)}")


if __name__ == "__main__":
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    main(*sys.argv[1:])
