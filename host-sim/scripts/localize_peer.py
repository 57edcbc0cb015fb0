#!/usr/bin/env python3
"""SciPy on the data of the bench `localize`: seconds per user, and how far its answers are from ours.

The peer solves each user alone with `scipy.optimize.least_squares`, the clocks given, emission times projected out,
from the drones' centroid: as called by default (trust region, Jacobian by differences), and in the best case for it
(Levenberg-Marquardt with the analytic Jacobian).

Run by `cargo xtask bench localize`; by hand: localize_peer.py captures.csv ours.csv   (numpy and scipy)
"""

import csv
import json
import sys
import time
from collections import defaultdict

import numpy as np
from scipy.optimize import least_squares

C = 0.299792458  # m/ns


def read(path):
    """Occasions of every user: positions (n, 3, 3) and arrivals (n, 3), only those that all three drones heard."""
    users = defaultdict(lambda: defaultdict(list))
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            at = [float(row[k]) for k in ("x_m", "y_m", "z_m")]
            users[row["user"]][row["epoch_s"]].append((int(row["drone"]), at, float(row["toa_ns"])))
    for user, epochs in users.items():
        full = [sorted(rows) for rows in epochs.values() if len(rows) == 3]
        yield user, np.array([[r[1] for r in rows] for rows in full]), np.array([[r[2] for r in rows] for rows in full])


def solve(at, toa, best, sigma_ns=5.0):
    start = at.mean(axis=(0, 1))[:2]

    def terms(p):
        way = np.concatenate([np.broadcast_to(p, at.shape[:2] + (2,)), np.zeros(at.shape[:2] + (1,))], axis=2) - at
        distance = np.linalg.norm(way, axis=2)
        return way, distance

    def residuals(p):
        r = toa - terms(p)[1] / C
        return ((r - r.mean(axis=1, keepdims=True)) / sigma_ns).ravel()

    def jacobian(p):
        way, distance = terms(p)
        u = -way[:, :, :2] / (distance[:, :, None] * C)
        return ((u - u.mean(axis=1, keepdims=True)) / sigma_ns).reshape(-1, 2)

    if best:
        return least_squares(residuals, start, jac=jacobian, method="lm").x
    return least_squares(residuals, start).x


def main(captures, ours):
    rows = csv.DictReader(open(ours, newline=""))
    known = {row["id"]: np.array([float(row["x_m"]), float(row["y_m"])]) for row in rows}
    users = list(read(captures))
    told = {"users": len(users)}
    for name, best in (("default", False), ("best", True)):
        begin = time.process_time()
        found = {user: solve(at, toa, best) for user, at, toa in users}
        told[f"{name}_cpu_s"] = time.process_time() - begin
        told["apart_median_m"] = float(np.median([np.linalg.norm(found[u] - known[u]) for u in found if u in known]))
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:3])
