"""Figures of the truth tests of the air-to-ground link, from SciPy (pip install scipy).

Maximises the radius over the altitude by a search that knows nothing of derivatives: for each altitude
the radius is the root of the loss in the form of the paper, and the altitude comes from a bounded scalar search
around the best of a grid. Prints environment, threshold (dB), frequency (Hz), altitude (m), radius (m),
and the radius from 300 m (0 where nobody is served)."""
from math import atan, exp, hypot, log10, pi

from scipy.optimize import brentq, minimize_scalar

ENVIRONMENTS = {
    "Suburban": (4.88, 0.43, 0.1, 21.0),
    "Urban": (9.61, 0.16, 1.0, 20.0),
    "DenseUrban": (12.08, 0.11, 1.6, 23.0),
    "Highrise": (27.23, 0.08, 2.3, 34.0),
}


def loss(environment, hertz, h, r):
    a, b, los, nlos = ENVIRONMENTS[environment]
    theta = 180 / pi * atan(h / r) if r > 0 else 90.0
    p = 1 / (1 + a * exp(-b * (theta - a)))
    return 20 * log10(4 * pi * hertz * hypot(h, r) / 299_792_458.0) + p * los + (1 - p) * nlos


def radius(environment, hertz, limit, h):
    f = lambda r: loss(environment, hertz, h, r) - limit
    return brentq(f, 0.0, 1e7, xtol=1e-9, rtol=1e-14) if f(0.0) < 0 else 0.0


for environment in ENVIRONMENTS:
    for limit, hertz in ((100.0, 2e9), (110.0, 2e9), (95.0, 7e8), (105.0, 5.8e9)):
        r = lambda h: radius(environment, hertz, limit, h)
        best = max((10 * 1.02**k for k in range(400)), key=r)
        found = minimize_scalar(lambda h: -r(h), bounds=(best / 1.02, best * 1.02), method="bounded",
                                options={"xatol": 1e-7})
        print(f"(Environment::{environment}, {limit}, {hertz:.1e}, {found.x:.3f}, {-found.fun:.6f}, {r(300.0):.6f}),")
