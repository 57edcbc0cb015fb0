"""Figures of `truth_agrees_with_geos` in tests.rs, from GEOS (pip install shapely).

Prints legs, sway and the uncovered area in square metres of a polygon and a spiral track; circles are
drawn with 16,000 corners, which leaves out 2.6e-8 of a disk."""
from math import cos, sin

from shapely import LineString, Polygon, union_all

polygon = Polygon([(100, 0), (2700, 150), (2950, 1700), (1500, 2450), (50, 1900)])
for legs, sway in [(20, 0.0), (60, 0.0), (120, 0.0), (120, 7.0), (240, 15.0)]:

    def point(t):
        r, a = 80 + 5 * t, 0.21 * t
        x = 1400 + r * cos(a) + sway * sin(2.7 * t)
        return x, 1200 + 0.8 * r * sin(a) + sway * cos(1.9 * t)

    disks = [
        LineString([point(i), point(i + 1)]).buffer(120 + 20 * sin(0.7 * i), quad_segs=4000)
        for i in range(legs)
    ]
    print(f"        ({legs}, {sway}, {polygon.difference(union_all(disks)).area:.4f}),")
