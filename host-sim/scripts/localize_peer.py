#!/usr/bin/env python3
"""SciPy on the data of the bench `localize`: seconds of CPU time, and how far its answers are from the truth.

    localize_peer.py each captures.csv truth.csv     clocks known, nothing late: every user by itself
    localize_peer.py joint captures.csv truth.csv    offsets of clocks unknown, some captures late: all at once

Either way emission times are projected out and the search starts at the drones' centroid. `each` solves by
`scipy.optimize.least_squares` as called by default (trust region, Jacobian by differences), and in the best case for it
(Levenberg-Marquardt with the analytic Jacobian); `joint` by trust region with the analytic sparse Jacobian, LSMR and
a robust loss (soft_l1).

Run by `cargo xtask bench localize`; needs numpy and scipy.
"""

import csv
import json
import sys
import time

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix

C = 0.299792458  # m/ns
SIGMA_NS = 5.0


class Captures:
    """All captures, a row each: positions (n, 3), arrivals (n), and to which user, occasion and drone they belong."""

    def __init__(self, path):
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        self.at = np.array([[float(r[k]) for k in ("x_m", "y_m", "z_m")] for r in rows])
        self.toa = np.array([float(r["toa_ns"]) for r in rows])
        self.ids, self.user = np.unique([int(r["user"]) for r in rows], return_inverse=True)
        self.occasion = np.unique([r["user"] + "@" + r["epoch_s"] for r in rows], return_inverse=True)[1]
        self.drones, self.drone = np.unique([int(r["drone"]) for r in rows], return_inverse=True)
        self.count = np.bincount(self.occasion)

    def less_mean(self, values):
        """Values less their mean over the occasion: what is left without its emission time."""
        return values - (np.bincount(self.occasion, values) / self.count)[self.occasion]


def solve_alone(at, toa, best):
    """One user; `at` (n, 3, 3) and `toa` (n, 3) have an occasion a row."""
    start = at.mean(axis=(0, 1))[:2]

    def terms(p):
        way = np.concatenate([np.broadcast_to(p, at.shape[:2] + (2,)), np.zeros(at.shape[:2] + (1,))], axis=2) - at
        return way, np.linalg.norm(way, axis=2)

    def residuals(p):
        r = toa - terms(p)[1] / C
        return ((r - r.mean(axis=1, keepdims=True)) / SIGMA_NS).ravel()

    def jacobian(p):
        way, distance = terms(p)
        u = -way[:, :, :2] / (distance[:, :, None] * C)
        return ((u - u.mean(axis=1, keepdims=True)) / SIGMA_NS).reshape(-1, 2)

    if best:
        return least_squares(residuals, start, jac=jacobian, method="lm").x
    return least_squares(residuals, start).x


def each(captures):
    """Only occasions that all three drones heard."""
    full = (captures.count == 3)[captures.occasion]
    order = np.lexsort((captures.drone, captures.occasion))
    order = order[full[order]].reshape(-1, 3)
    owner = captures.user[order[:, 0]]
    users = [order[owner == u] for u in range(len(captures.ids))]
    data = [(captures.at[rows], captures.toa[rows]) for rows in users]
    told = {}
    for name, best in (("default_cpu_s", False), ("best_cpu_s", True)):
        begin = time.process_time()
        found = np.array([solve_alone(at, toa, best) for at, toa in data])
        told[name] = time.process_time() - begin
    return told, found


def joint(captures):
    users, rows = len(captures.ids), np.arange(len(captures.toa))
    begin = time.process_time()
    heard = np.bincount(captures.user)
    centroid = [np.bincount(captures.user, captures.at[:, k]) / heard for k in (0, 1)]
    # Offsets against the first drone. Each in the unit in which its errors are alike: ten metres and a nanosecond.
    unit = np.array([10.0, 10.0, 1.0])
    start = np.concatenate([np.concatenate(centroid) / 10.0, np.zeros(len(captures.drones) - 1)])

    def terms(x):
        p = x[: 2 * users].reshape(2, users)[:, captures.user].T * unit[:2]
        way = np.column_stack([p, np.zeros(len(rows))]) - captures.at
        return way, np.linalg.norm(way, axis=1)

    def residuals(x):
        offset = np.concatenate([[0.0], x[2 * users :]])[captures.drone]
        return captures.less_mean(captures.toa - terms(x)[1] / C - offset) / SIGMA_NS

    columns = [captures.user, users + captures.user]
    columns += [np.full(len(rows), 2 * users + d) for d in range(len(captures.drones) - 1)]
    clocks = [-captures.less_mean((captures.drone == d + 1).astype(float)) for d in range(len(captures.drones) - 1)]

    def jacobian(x):
        way, distance = terms(x)
        values = [captures.less_mean(-way[:, k] / (distance * C)) * unit[k] for k in (0, 1)] + clocks
        where = (np.tile(rows, len(columns)), np.concatenate(columns))
        return csr_matrix((np.concatenate(values) / SIGMA_NS, where), shape=(len(rows), len(x)))

    solved = least_squares(residuals, start, jac=jacobian, loss="soft_l1", f_scale=2.0)
    found = solved.x[: 2 * users].reshape(2, users).T * unit[:2]
    return {"cpu_s": time.process_time() - begin, "evaluations": solved.nfev}, found


def main(how, captures, truth):
    captures = Captures(captures)
    told, found = {"each": each, "joint": joint}[how](captures)
    with open(truth, newline="") as file:
        known = {int(row["id"]): [float(row["x_m"]), float(row["y_m"])] for row in csv.DictReader(file)}
    off = found - np.array([known[user] for user in captures.ids])
    told["off_median_m"] = float(np.median(np.linalg.norm(off, axis=1)))
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:4])
