"""Writes files of captures and checks what `skyroost locate` makes of them, independently of its code.

Usage: captures.py write CASE SEED FILE.csv TRUTH.json
       captures.py check FILE.csv TRUTH.json LOCATE.json

Takes nothing but Python. `write` flies three or more drones along two lanes past users on the ground; every
arrival is light's time from the user, the drone's clock and noise, kept as whole picoseconds, so that no digit is
lost however large the clocks' counts are. `check` reads the file again and solves for every user that claims a position by
Gauss-Newton from the truth, with clocks as the truth has them where the locator was told of none, and holds positions,
covariances, radii and clocks against that and against the truth. Prints what it compared; what is wrong ends it
with exit status 1."""
import csv
import json
import math
import random
import sys
from fractions import Fraction

C_M_PER_NS = 0.299792458
HEIGHT_M, SPEED_MPS, RADIUS_M, SPACING_M = 300.0, 10.0, 471.0, 50.0
LANE_M, LENGTH_M = 700.0, 2400.0

CASES = {
    # users, seconds between occasions, noise in ns, share late, share lost, clocks as (offset ns, drift ns/s), first
    # epoch in s, count of the clocks at the first epoch in ns
    "plain": dict(users=30, every_s=2, sigma_ns=5, late=0, lost=0.1, clocks=[(0, 0)] * 3, epoch_s=0, count_ns=0),
    "late": dict(users=30, every_s=2, sigma_ns=5, late=0.05, lost=0.1, clocks=[(0, 0)] * 3, epoch_s=0, count_ns=0),
    "constant": dict(users=30, every_s=2, sigma_ns=5, late=0.05, lost=0.1, clocks=[(90, 0), (-150, 0), (35, 0)],
                     epoch_s=1_700_000_000, count_ns=1_700_000_000 * 10**9),
    "linear": dict(users=30, every_s=2, sigma_ns=5, late=0.03, lost=0.1, clocks=[(9e9, 2), (-3e14, -4), (0, 3.5)],
                   epoch_s=1_700_000_000, count_ns=0),
    "five": dict(users=30, every_s=2, sigma_ns=5, late=0, lost=0.1, clocks=[(0, 0)] * 5, epoch_s=0, count_ns=0),
    "sample": dict(users=9, every_s=4, sigma_ns=5, late=0.02, lost=0.05, clocks=[(20, 0), (-95, 0), (140, 0)],
                   epoch_s=1_700_000_000, count_ns=0),
}


def formation(at, drones):
    """Places of a fleet around its centre: a regular polygon with sides of SPACING_M."""
    reach = SPACING_M / (2 * math.sin(math.pi / drones))
    turn = [2 * math.pi * (k / drones + 0.25) for k in range(drones)]
    return [(at[0] + reach * math.cos(t), at[1] + reach * math.sin(t), HEIGHT_M) for t in turn]


def centre(time_s):
    """East along the first lane, north, and west along the second."""
    way = SPEED_MPS * time_s
    if way < LENGTH_M:
        return way, 0.0
    if way < LENGTH_M + LANE_M:
        return LENGTH_M, way - LENGTH_M
    return 2 * LENGTH_M + LANE_M - way, LANE_M


def write(case, seed, table, truth_file):
    dice = random.Random(f"{case} {seed}")
    drones = len(case["clocks"])
    users = {f"u{k + 1}": (dice.uniform(0, LENGTH_M), dice.uniform(-300, LANE_M + 300)) for k in range(case["users"])}
    phase = {name: Fraction(dice.randrange(10**6), 10**6) for name in users}
    rows = []
    for step in range(0, int((2 * LENGTH_M + LANE_M) / SPEED_MPS), case["every_s"]):
        for name, (x, y) in users.items():
            time_s = step + phase[name]
            at = centre(float(time_s))
            if math.hypot(x - at[0], y - at[1]) > RADIUS_M:
                continue
            # Emitted some time in the millisecond after the epoch, in picoseconds of a common time.
            emitted_ps = int(time_s * 10**12) + dice.randrange(10**9)
            for drone, place in enumerate(formation(at, drones)):
                if dice.random() < case["lost"]:
                    continue
                way_ns = math.dist(place, (x, y, 0.0)) / C_M_PER_NS
                offset_ns, drift = case["clocks"][drone]
                noise_ns = dice.gauss(0, case["sigma_ns"]) + drift * float(time_s)
                if dice.random() < case["late"]:
                    noise_ns += dice.uniform(100, 1000)
                toa_ps = emitted_ps + round(1000 * (way_ns + noise_ns)) + 1000 * (case["count_ns"] + int(offset_ns))
                sign, digits = "-" if toa_ps < 0 else "", abs(toa_ps)
                micros = case["epoch_s"] * 10**6 + int(time_s * 10**6)
                rows.append([name, f"{micros // 10**6}.{micros % 10**6:06}", str(drone + 1), *(f"{c:.2f}" for c in place),
                             f"{sign}{digits // 1000}.{digits % 1000:03}", str(case["sigma_ns"])])
    with open(table, "w", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow("user epoch_s drone x_m y_m z_m toa_ns sigma_ns".split())
        writer.writerows(rows)
    with open(truth_file, "w") as out:
        json.dump({"users": users, "clocks": case["clocks"], "epoch_s": case["epoch_s"]}, out)


def expect(holds, what):
    if not holds:
        sys.exit(what)


def read(table):
    """Occasions of every user: lists of (drone's number, place, arrival as a fraction, sigma, epoch)."""
    heard = {}
    with open(table, newline="") as source:
        for row in csv.DictReader(source):
            place = tuple(float(row[k]) for k in ("x_m", "y_m", "z_m"))
            capture = (int(row["drone"]) - 1, place, Fraction(row["toa_ns"]), float(row["sigma_ns"]))
            heard.setdefault(row["user"], {}).setdefault(Fraction(row["epoch_s"]), []).append(capture)
    return {user: [(epoch, c) for epoch, c in sorted(by.items()) if len(c) > 1] for user, by in heard.items()}


def inverse(xx, xy, yy):
    det = xx * yy - xy * xy
    return yy / det, -xy / det, xx / det


def solve(occasions, start, clock_ns, steps):
    """Weighted least squares, one emission time for each occasion: position and covariance."""
    p = start
    for _ in range(steps):
        info, gradient = [0.0] * 3, [0.0] * 2
        for epoch, captures in occasions:
            base = captures[0][2]
            lines = []
            for drone, place, toa_ns, sigma_ns in captures:
                way = math.dist(place, (*p, 0.0))
                residual = float(toa_ns - base - clock_ns(drone, epoch)) - way / C_M_PER_NS
                slope = [(p[k] - place[k]) / way / C_M_PER_NS for k in range(2)]
                lines.append((sigma_ns**-2, residual, slope))
            total = sum(w for w, _, _ in lines)
            mean = sum(w * r for w, r, _ in lines) / total
            middle = [sum(w * s[k] for w, _, s in lines) / total for k in range(2)]
            for w, r, s in lines:
                d = [s[k] - middle[k] for k in range(2)]
                for k in range(2):
                    gradient[k] += w * d[k] * (r - mean)
                info[0] += w * d[0] * d[0]
                info[1] += w * d[0] * d[1]
                info[2] += w * d[1] * d[1]
        cov = inverse(*info)
        step = cov[0] * gradient[0] + cov[1] * gradient[1], cov[1] * gradient[0] + cov[2] * gradient[1]
        p = p[0] + step[0], p[1] + step[1]
        if math.hypot(*step) < 1e-6:
            break
    return p, cov


def check(table, truth_file, answer_file):
    with open(truth_file) as source:
        truth = json.load(source)
    with open(answer_file) as source:
        answer = json.load(source)
    heard = read(table)
    expect({user["id"] for user in answer["users"]} == set(heard), "the users are others than the file's")
    clocks = truth["clocks"]

    def clock_ns(drone, epoch):
        offset, drift = clocks[drone]
        return int(offset) + Fraction(drift) * (epoch - truth["epoch_s"])

    found = [user for user in answer["users"] if user["status"] == "ok"]
    expect(len(found) >= 0.9 * len(heard), f"only {len(found)} of {len(heard)} are ok")
    clean = answer["options"]["robust"] == "none" and answer["clock"]["model"] == "none"
    within, squares = 0, 0.0
    for user in found:
        p, (xx, xy, yy) = (user["x_m"], user["y_m"]), (user["cov_m2"][i][j] for i, j in ((0, 0), (0, 1), (1, 1)))
        occasions = heard[user["id"]]
        expect(user["occasions"] == len(occasions), f"{user}: {len(occasions)} occasions")
        place = truth["users"][user["id"]]
        error = p[0] - place[0], p[1] - place[1]
        within += math.hypot(*error) <= user["r95_m"]
        a, b, c = inverse(xx, xy, yy)
        squares += a * error[0] ** 2 + 2 * b * error[0] * error[1] + c * error[1] ** 2
        # Occasions divided among more than three drones lose some of what they hold.
        if clean and len(clocks) == 3:
            known, cov = solve(occasions, place, clock_ns, 20)
            off = math.dist(p, known)
            expect(off < 0.02 * user["r95_m"] + 0.01, f"{user['id']}: {off} m from least squares")
            for mine, theirs in zip((xx, xy, yy), cov):
                expect(abs(mine - theirs) < 0.02 * math.sqrt(cov[0] * cov[2]), f"{user['id']}: covariance {mine}, {theirs}")
        else:
            # Nothing can be surer than with clocks known and no capture late.
            _, cov = solve(occasions, place, clock_ns, 1)
            expect(xx + yy > 0.9 * (cov[0] + cov[2]), f"{user['id']}: covariance below the bound")
    expect(within >= 0.85 * len(found), f"{within} of {len(found)} are within their radius")
    ratio = math.sqrt(squares / (2 * len(found)))
    expect(0.75 < ratio < 1.25, f"errors are {ratio} times what the covariances say")

    offsets, drifts = answer["clock"]["offset_ns"], answer["clock"]["drift_ns_per_s"]
    reference = int(answer["clock"]["reference_drone"]) - 1
    if answer["clock"]["model"] != "none":
        at = answer["clock"]["reference_epoch_s"] - truth["epoch_s"]
        for drone, (offset, drift) in enumerate(clocks):
            name = str(drone + 1)
            slope = drift - clocks[reference][1]
            expected = offset - clocks[reference][0] + slope * at
            expect(abs(offsets[name] - expected) < 8, f"drone {name}: offset {offsets[name]}, expected {expected}")
            if answer["clock"]["model"] == "shared-linear":
                expect(abs(drifts[name] - slope) < 0.05, f"drone {name}: drift {drifts[name]}, expected {slope}")
    else:
        expect(all(value == 0 for value in [*offsets.values(), *drifts.values()]), "synchronised clocks are off")
    print(f"{len(found)} users, {within} within, ratio {ratio:.3f}")


if sys.argv[1] == "write":
    write(CASES[sys.argv[2]], sys.argv[3], *sys.argv[4:])
else:
    check(*sys.argv[2:])
