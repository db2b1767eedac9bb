"""Copies a 7-Scenes recording with poses that drift as odometry does: the error walks at random, yaw by 0.5 degrees and
place by 5 cm after 10 m of path, times STRENGTH. Depth images are linked, not copied.

    python3 extras/walk_poses.py RECORDING COPY UP STRENGTH SEED

UP is the world's up direction, for example 0.0055,0.453,-0.8914. Needs numpy.
"""

import pathlib
import sys

import numpy as np

YAW, SHIFT, PATH = np.radians(0.5), 0.05, 10.0


def moved(turn, shift):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, shift
    return out


def about(axis, angle):
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def main():
    source, copy = (pathlib.Path(p).resolve() for p in sys.argv[1:3])
    up = np.array([float(v) for v in sys.argv[3].split(",")])
    up /= np.linalg.norm(up)
    strength, rng = float(sys.argv[4]), np.random.default_rng(int(sys.argv[5]))
    copy.mkdir(parents=True)
    error, last = np.eye(4), None
    for path in sorted(source.iterdir()):
        if not path.name.endswith(".pose.txt"):
            (copy / path.name).symlink_to(path)
            continue
        pose = np.loadtxt(path)
        at = pose[:3, 3]
        if last is not None:
            root = strength * np.sqrt(np.linalg.norm(at - last) / PATH)
            turn = about(up, rng.normal() * YAW * root)
            here, back = moved(np.eye(3), at), moved(np.eye(3), -at)
            error = here @ moved(turn, rng.normal(size=3) * SHIFT * root) @ back @ error
        last = at
        np.savetxt(copy / path.name, error @ pose)
    off = np.linalg.norm(error[:3, :3] @ last + error[:3, 3] - last)
    yaw = np.degrees(np.arccos(min(1.0, (np.trace(error[:3, :3]) - 1) / 2)))
    print(f"in the end {off:.3f} m, {yaw:.2f} degrees off")


main()
