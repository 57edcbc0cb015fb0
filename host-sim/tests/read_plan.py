"""Reads the QGroundControl plan files of a sweep independently of the code that wrote them.

Usage: read_plan.py DIR SWEEP.json AREA.geojson

Takes nothing but Python: the structure is that of QGroundControl's documentation of plan files
(https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html), and places are turned
into metres by Vincenty's inverse formula (Survey Review 23, 1975), not by a projection. Each file must hold the
way that the JSON promises, and a fence that holds the way and the area. Prints how many files and waypoints
it compared; what is wrong ends it with exit status 1."""
import json
import math
import sys
from pathlib import Path

A, F = 6378137.0, 1 / 298.257223563
B = A * (1 - F)
ITEM = {"autoContinue", "command", "doJumpId", "frame", "params", "type"}
TAKEOFF, SPEED, WAYPOINT, RETURN = 22, 178, 16, 20


def inverse(lat1, lon1, lat2, lon2):
    """Length of the geodesic in metres and its azimuth at the first point, from north to the east."""
    if (lat1, lon1) == (lat2, lon2):
        return 0.0, 0.0
    u1, u2 = (math.atan((1 - F) * math.tan(math.radians(lat))) for lat in (lat1, lat2))
    l = math.radians((lon2 - lon1 + 180) % 360 - 180)
    (s1, c1), (s2, c2) = ((math.sin(u), math.cos(u)) for u in (u1, u2))
    lam = l
    for _ in range(100):
        sin_sigma = math.hypot(c2 * math.sin(lam), c1 * s2 - s1 * c2 * math.cos(lam))
        cos_sigma = s1 * s2 + c1 * c2 * math.cos(lam)
        sigma = math.atan2(sin_sigma, cos_sigma)
        sin_alpha = c1 * c2 * math.sin(lam) / sin_sigma
        cos2_alpha = 1 - sin_alpha**2
        cos_2m = cos_sigma - 2 * s1 * s2 / cos2_alpha if cos2_alpha else 0.0
        c = F / 16 * cos2_alpha * (4 + F * (4 - 3 * cos2_alpha))
        before = lam
        lam = l + (1 - c) * F * sin_alpha * (
            sigma + c * sin_sigma * (cos_2m + c * cos_sigma * (2 * cos_2m**2 - 1)))
        if abs(lam - before) < 1e-14:
            break
    k = cos2_alpha * (A * A - B * B) / (B * B)
    a = 1 + k / 16384 * (4096 + k * (-768 + k * (320 - 175 * k)))
    b = k / 1024 * (256 + k * (-128 + k * (74 - 47 * k)))
    more = b * sin_sigma * (cos_2m + b / 4 * (
        cos_sigma * (2 * cos_2m**2 - 1) - b / 6 * cos_2m * (4 * sin_sigma**2 - 3) * (4 * cos_2m**2 - 3)))
    azimuth = math.atan2(c2 * math.sin(lam), c1 * s2 - s1 * c2 * math.cos(lam))
    return B * a * (sigma - more), azimuth


def metres(origin, lat, lon):
    """East and north along the geodesic from the origin; a transverse Mercator is within centimetres of that."""
    length, azimuth = inverse(origin["lat_deg"], origin["lon_deg"], lat, lon)
    return length * math.sin(azimuth), length * math.cos(azimuth)


def expect(holds, place, what):
    if not holds:
        sys.exit(f"{place}: {what}")


def number(x):
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x)


def place_on_earth(lat, lon):
    return number(lat) and number(lon) and -90 <= lat <= 90 and -180 <= lon <= 180


def inside(ring, point):
    """Whether a point lies in a ring, by crossings of a ray to the east."""
    x, y = point
    crossings = 0
    for (x1, y1), (x2, y2) in zip(ring, ring[1:] + ring[:1]):
        if (y1 > y) != (y2 > y) and x < x1 + (x2 - x1) * (y - y1) / (y2 - y1):
            crossings += 1
    return crossings % 2 == 1


def check(path, sweep, area, used):
    plan = json.loads(path.read_text(encoding="utf-8"))
    expect(plan["fileType"] == "Plan" and plan["version"] == 1, path, "no plan file of version 1")
    expect(isinstance(plan["groundStation"], str), path, "groundStation is no text")
    expect(plan["rallyPoints"] == {"version": 2, "points": []}, path, "rally points")
    mission = plan["mission"]
    expect(mission["version"] == 2, path, "no mission of version 2")
    for key in ("firmwareType", "vehicleType", "globalPlanAltitudeMode"):
        expect(isinstance(mission[key], int), path, f"{key} is no number")
    for key in ("cruiseSpeed", "hoverSpeed"):
        expect(mission[key] == sweep["speed_mps"], path, f"{key} is {mission[key]}")
    home = mission["plannedHomePosition"]
    expect(len(home) == 3 and place_on_earth(*home[:2]) and number(home[2]), path, f"home at {home}")

    items = mission["items"]
    for count, item in enumerate(items, 1):
        expect(item["type"] == "SimpleItem" and ITEM <= item.keys(), path, f"item {count} is {item}")
        expect(item["doJumpId"] == count and item["autoContinue"] is True, path, f"item {count} is {item}")
        params = item["params"]
        expect(len(params) == 7 and all(p is None or number(p) for p in params), path, f"{params}")
        if item["command"] in (TAKEOFF, WAYPOINT):
            expect(item["frame"] == 3 and item["AltitudeMode"] == 1, path, f"altitude of item {count}")
            expect(item["Altitude"] == params[6] == sweep["altitude_m"], path, f"altitude of item {count}")
            expect(place_on_earth(*params[4:6]), path, f"item {count} at {params[4:6]}")
        else:
            expect(item["frame"] == 2, path, f"item {count} has frame {item['frame']}")
    commands = [item["command"] for item in items]
    body = len(items) - 3
    expect(commands == [TAKEOFF, SPEED] + [WAYPOINT] * body + [RETURN], path, f"commands are {commands}")
    expect(items[0]["params"][4:6] == home[:2], path, "take-off is not at home")
    expect(items[1]["params"][:2] == [1, sweep["speed_mps"]], path, "speed")

    # fleetF-droneD: its slot is a point of an equilateral triangle around the fleet's centre.
    fleet, drone = (int(word.strip("fletdron")) for word in path.stem.split("-"))
    expected = sweep["sub_areas"][fleet - 1]
    angle = sweep["sweep_direction_rad"] + math.pi / 2 + (drone - 1) * 2 * math.pi / 3
    reach = sweep["spacing_m"] / math.sqrt(3)
    slot = (reach * math.cos(angle), reach * math.sin(angle))
    places = [tuple(item["params"][4:6]) for item in items if item["command"] in (TAKEOFF, WAYPOINT)]
    way = [metres(sweep["origin"], *place) for place in places]
    centres = [expected["pad_m"]] + expected["approach_m"] + expected["path_m"] + expected["way_back_m"]
    expect(len(way) == len(centres), path, f"{len(way)} places for {len(centres)} centres")
    for found, centre in zip(way, centres):
        off = math.dist(found, (centre[0] + slot[0], centre[1] + slot[1]))
        expect(off < 0.05, path, f"a place is {off} m off: {found} for {centre}")
    expect((fleet, drone) not in used, path, "a drone twice")
    used.add((fleet, drone))

    fence = plan["geoFence"]
    expect(fence["version"] == 2 and fence["circles"] == [], path, "geofence of version 2 without circles")
    rings = {True: [], False: []}
    for polygon in fence["polygons"]:
        expect(polygon["version"] == 1 and isinstance(polygon["inclusion"], bool), path, "a fence's head")
        expect(len(polygon["polygon"]) >= 3 and all(place_on_earth(*p) for p in polygon["polygon"]), path, "a fence")
        rings[polygon["inclusion"]].append([metres(sweep["origin"], *p) for p in polygon["polygon"]])
    expect(len(rings[True]) == 1, path, f"{len(rings[True])} inclusion fences")
    expect(len(rings[False]) == len(sweep["no_fly_m"]), path, f"{len(rings[False])} exclusion fences")
    ring = rings[True][0]
    for a, b in zip(way, way[1:] + way[:1]):
        for k in range(21):
            point = (a[0] + (b[0] - a[0]) * k / 20, a[1] + (b[1] - a[1]) * k / 20)
            expect(inside(ring, point), path, f"{point} lies outside of the fence")
            expect(not any(inside(zone, point) for zone in rings[False]), path, f"{point} lies in a zone")
            room = min(to_edge(point, *edge) for edge in zip(ring, ring[1:] + ring[:1]))
            expect(room > 45, path, f"{point} is {room} m from the fence")
    for corner in area:
        expect(inside(ring, metres(sweep["origin"], corner[1], corner[0])), path, f"{corner} outside of the fence")
    return body


def to_edge(point, a, b):
    """Distance of a point from an edge."""
    d = (b[0] - a[0], b[1] - a[1])
    along = ((point[0] - a[0]) * d[0] + (point[1] - a[1]) * d[1]) / (d[0] ** 2 + d[1] ** 2)
    along = min(1.0, max(0.0, along))
    return math.dist(point, (a[0] + along * d[0], a[1] + along * d[1]))


def corners(value):
    """All positions below a GeoJSON object."""
    if isinstance(value, dict):
        return corners(value.get("features") or value.get("geometry") or value.get("coordinates"))
    if value and number(value[0]):
        return [value]
    return [position for part in value for position in corners(part)]


def main():
    folder, sweep, area = Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])
    sweep = json.loads(sweep.read_text(encoding="utf-8"))
    area = corners(json.loads(area.read_text(encoding="utf-8")))
    used = set()
    waypoints = [check(path, sweep, area, used) for path in sorted(folder.iterdir())]
    expect(len(used) == 3 * len(sweep["sub_areas"]), folder, f"plans of {sorted(used)}")
    print(f"{len(waypoints)} plans, {sum(waypoints)} waypoints")


main()
