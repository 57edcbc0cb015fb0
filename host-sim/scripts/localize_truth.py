#!/usr/bin/env python3
"""Truth figures for the tests of `control/localize`: SciPy on cases small enough to solve whole.

Nothing is shared with the Rust code but the formulas of the model: emission times and clocks are ordinary
unknowns here, solved by a dense trust region, and covariances are the dense inverse of J'J.

Run: python3 host-sim/scripts/localize_truth.py   (numpy and scipy)
"""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq, least_squares

C = 0.299792458  # m/ns
SIDE = 50 / np.sqrt(3)


def hashed(*key):
    """A number in [-1, 1) from small integers, the same in Rust: noise without a generator."""
    x = 17
    for k in (*key, 1, 2):
        x = ((x ^ (x >> 13)) * 1103515245 + k * 12345 + 12820163) % 2**31
    return x / 2**30 - 1


USERS = [(120.0, 210.0), (310.0, -330.0), (520.0, 60.0), (700.0, -140.0)]
CLOCK = [(0.0, 0.0), (130.0, 3.0), (-75.0, -4.5)]  # offset at t = 0, drift per second


def case():
    """Fleet flying east at 10 m/s along y = 0, users heard within 471 m, every third second."""
    rows = []  # user, t, drone, position, toa, lateness
    for t in range(0, 90, 3):
        x = 10.0 * t
        for u, p in enumerate(USERS):
            if np.hypot(p[0] - x, p[1]) > 471:
                continue
            for d in range(3):
                if (t + u + d) % 7 == 0:
                    continue  # a capture missing now and then
                a = 2 * np.pi * (d / 3 + 0.25)
                at = (x + SIDE * np.cos(a), SIDE * np.sin(a), 300.0)
                toa = np.linalg.norm(np.subtract((*p, 0.0), at)) / C + CLOCK[d][0] + CLOCK[d][1] * t
                late = 300.0 if (5 * t + 3 * u + d) % 23 == 0 else 0.0  # used with `tukey` only
                rows.append((u, t, d, at, toa + 8 * hashed(u, t, d), late))
    return rows


def tukey(z, c=6.0):
    """SciPy's convention: z is the squared residual; the cost rho and its first two derivatives."""
    t = np.minimum(z / c**2, 1)
    return np.array([c**2 / 3 * (1 - (1 - t) ** 3), (1 - t) ** 2, -2 / c**2 * (1 - t)])


def solve(model, robust=False):
    rows = [(u, t, d, at, toa + robust * late) for u, t, d, at, toa, late in case()]
    occasions = sorted({(u, t) for u, t, *_ in rows})
    index = {o: i for i, o in enumerate(occasions)}
    n_u, n_o = len(USERS), len(occasions)
    t0 = min(t for _, t, *_ in rows)
    span = max(t for _, t, *_ in rows) - t0
    # Unknowns: positions, emission times, clock offsets, clock drifts over the span (reference: drone 0).
    clocks = {"synchronised": 0, "constant": 2, "linear": 4}[model]
    # The prior of a difference of two independent clocks: covariance s^2 (I + 11').
    root = np.linalg.cholesky(np.linalg.inv(np.eye(2) + 1)).T

    def residuals(z):
        pos, emission, clk = z[: 2 * n_u].reshape(-1, 2), z[2 * n_u : 2 * n_u + n_o], z[2 * n_u + n_o :]
        out = []
        for u, t, d, at, toa in rows:
            clock = clk[d - 1] if clocks and d else 0.0
            if clocks == 4 and d:
                clock += clk[2 + d - 1] * (t - t0) / span
            distance = np.sqrt((pos[u][0] - at[0]) ** 2 + (pos[u][1] - at[1]) ** 2 + at[2] ** 2)
            true_toa = toa - (CLOCK[d][0] + CLOCK[d][1] * t if not clocks else 0)
            if clocks == 2:
                true_toa -= CLOCK[d][1] * t
            out.append((true_toa - distance / C - clock - emission[index[u, t]]) / 5.0)
        for u in range(n_u):  # the weak prior of the estimator
            # one entry per occasion with two captures or more or one: the mean position of its drones
            means = [np.mean([r[3] for r in rows if (r[0], r[1]) == o], axis=0) for o in occasions if o[0] == u]
            centre = np.mean(means, axis=0)
            out += [(pos[u][k] - centre[k]) / 471.0 for k in range(2)]
        if clocks == 4:
            out += list(root @ clk[:2] / 200.0) + list(root @ clk[2:] / (5.0 * span))
        if clocks == 2:
            out += list(root @ clk / 1e5)
        return np.array(out)

    start = np.concatenate([np.ravel(USERS), np.zeros(n_o + clocks)])
    if robust:  # from the clean answer, so that SciPy's local search starts in the right basin
        emission = start[2 * n_u : 2 * n_u + n_o]
        for (u, t), i in index.items():
            early = [toa - np.linalg.norm(np.subtract((*USERS[u], 0.0), at)) / C - CLOCK[d][0] - CLOCK[d][1] * t
                     for v, s, d, at, toa in rows if (v, s) == (u, t)]
            emission[i] = np.median(early) if len(early) == 3 else np.mean(early)
        start[2 * n_u + n_o :] = [130, -75, 3 * span, -4.5 * span]
        fit = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, loss=tukey, x_scale="jac", max_nfev=5000)
    else:
        fit = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, method="lm")
    cov = np.linalg.inv(fit.jac.T @ fit.jac)
    print(f"// {model}{' tukey' if robust else ''}: east, north, cov xx, xy, yy")
    for u in range(n_u):
        x, y = fit.x[2 * u : 2 * u + 2]
        c = cov[2 * u : 2 * u + 2, 2 * u : 2 * u + 2]
        print(f"[{x:.6f}, {y:.6f}, {c[0, 0]:.8f}, {c[0, 1]:.8f}, {c[1, 1]:.8f}],")
    if clocks:
        print("// clocks:", ", ".join(f"{v:.6f}" for v in fit.x[2 * n_u + n_o :]))


def circle(ratio):
    """Radius that holds 95 % of a Gaussian with standard deviations 1 and `ratio`, by quadrature over x."""
    def inside(r):
        from math import erf
        f = lambda x: np.exp(-x * x / 2) / np.sqrt(2 * np.pi) * erf(np.sqrt(max(r * r - x * x, 0)) / (ratio * np.sqrt(2)))
        return 2 * quad(f, 0, r, epsabs=1e-13, epsrel=1e-13, limit=400)[0]
    return brentq(lambda r: inside(r) - 0.95, 1.9, 2.5, xtol=1e-13)


print("// r95:", ", ".join(f"({q}, {circle(q):.10f})" for q in (0.1, 0.3, 0.5, 0.8, 0.95)))
for m in ("synchronised", "constant", "linear"):
    solve(m)
solve("linear", robust=True)
