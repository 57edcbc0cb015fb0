"""Figures of the truth tests in frame.rs, from PROJ (pip install pyproj; Poder and Engsager, PROJ 9).

Prints one row per point: origin longitude and latitude, longitude and latitude, east and north metres
of the transverse Mercator projection, and the length of the geodesic from the origin."""
from pyproj import Geod, Proj

geod = Geod(ellps="WGS84")
for lon0, lat0 in [(13.7, 51.05), (-58.4, -34.6), (179.95, -16.5), (25.0, 69.9), (0.0, 0.0)]:
    tmerc = Proj(f"+proj=tmerc +lat_0={lat0} +lon_0={lon0} +k=1 +ellps=WGS84")
    for dlon, dlat in [(0.09, 0.07), (-0.13, 0.02), (0.01, -0.17), (1.5, 2.0)]:
        lon, lat = lon0 + dlon, lat0 + dlat
        x, y = tmerc(lon, lat)
        distance = geod.inv(lon0, lat0, lon, lat)[2]
        print(f"    [{lon0}, {lat0}, {lon:.2f}, {lat:.2f}, {x:.6f}, {y:.6f}, {distance:.6f}],")
