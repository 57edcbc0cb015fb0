"""Figures of the truth tests of areas, from PROJ (pip install pyproj; Poder and Engsager, PROJ 9).

Prints for each area the middle of its bounding box, its vertices (longitude, latitude, east and north in the
transverse Mercator projection at that middle, length of the geodesic to the next vertex), and the area that
GeographicLib finds within the geodesics between them."""
from pyproj import Geod, Proj

geod = Geod(ellps="WGS84")
AREAS = {
    "ELBE": [(13.70, 51.05), (13.80, 51.04), (13.85, 51.09), (13.75, 51.12)],
    "ARCTIC": [(20.0, 84.95), (21.7, 84.93), (21.5, 85.06), (20.9, 85.03), (20.1, 85.08)],
    "DATE_LINE": [(179.93, -16.55), (180.07, -16.52), (180.05, -16.41), (179.95, -16.44)],
    "AT_180": [(179.86, 65.0), (180.0, 65.0), (180.0, 65.07), (179.9, 65.06)],
}
for name, ring in AREAS.items():
    lons, lats = zip(*ring)
    lon0, lat0 = (min(lons) + max(lons)) / 2, (min(lats) + max(lats)) / 2
    tmerc = Proj(f"+proj=tmerc +lat_0={lat0} +lon_0={lon0} +k=1 +ellps=WGS84")
    print(f"const {name}: Truth<{len(ring)}> = Truth {{")
    print(f"    middle_deg: [{(lon0 + 180) % 360 - 180:.6f}, {lat0:.6f}],")
    print("    vertices: [")
    for (lon, lat), (lon2, lat2) in zip(ring, ring[1:] + ring[:1]):
        x, y = tmerc(lon, lat)
        length = geod.inv(lon, lat, lon2, lat2)[2]
        lon = lon - 360 if lon > 180 else lon
        print(f"        [{lon:.2f}, {lat:.2f}, {x:.6f}, {y:.6f}, {length:.6f}],")
    print("    ],")
    print(f"    area_m2: {geod.polygon_area_perimeter(lons, lats)[0]:.3f},")
    print("};")
