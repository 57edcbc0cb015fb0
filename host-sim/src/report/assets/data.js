// The embedded recording, read once into the shapes the page works with.

/** Columns of a user's row; `UserRow` in embed.rs writes them in this order. */
const USER_COLUMNS = [
  "id", "truth_m", "estimate_m", "cov_m2", "r95_m", "status",
  "occasions", "heard_s", "guaranteed_by", "actual_by",
];

/** Half axes of a 95 % error ellipse per standard deviation: sqrt of the chi-square quantile, two degrees of freedom. */
const ELLIPSE_95 = Math.sqrt(5.991464547);

function readData() {
  const data = JSON.parse(byId("data").textContent);
  data.summary ??= {};
  data.drones = data.drones.map(readDrone);
  data.users = data.users.map((row) => readUser(row, data.sweep_s[1]));
  data.phases = data.phases.filter((phase) => isNumber(phase.t_s));
  data.events = data.events.filter((event) => isNumber(event.t_s)).sort((a, b) => a.t_s - b.t_s);
  data.placements = data.placements.filter((placement) => placement.pos_m.every(isNumber));
  data.appearances_s = Float64Array.from(data.users, (user) => user.appears_s).sort();
  return data;
}

function readDrone({ id, fleet, track }) {
  return {
    id,
    fleet,
    t_s: sums(track.t_cs, 0.01),
    e_m: sums(track.e_dm, 0.1),
    n_m: sums(track.n_dm, 0.1),
    u_m: sums(track.u_dm, 0.1),
    dropped: track.dropped,
  };
}

/** Undoes the differences of a packed column. */
function sums(steps, unit) {
  const values = new Float64Array(steps.length);
  let sum = 0;
  steps.forEach((step, i) => {
    sum += step;
    values[i] = sum * unit;
  });
  return values;
}

function readUser(row, sweepEnd_s) {
  const user = Object.fromEntries(USER_COLUMNS.map((name, i) => [name, row[i]]));
  user.appears_s = user.heard_s ?? sweepEnd_s;
  if (!user.estimate_m?.every(isNumber)) user.estimate_m = null;
  user.error_m = user.estimate_m
    ? Math.hypot(user.estimate_m[0] - user.truth_m[0], user.estimate_m[1] - user.truth_m[1])
    : null;
  user.ellipse = user.estimate_m && user.cov_m2?.every(isNumber) ? errorEllipse(user.cov_m2) : null;
  return user;
}

/** Half axes and direction of the 95 % ellipse: the closed form of a symmetric 2x2 eigenproblem. */
function errorEllipse([ee, en, nn]) {
  const mean = (ee + nn) / 2;
  const spread = Math.hypot((ee - nn) / 2, en);
  return {
    major_m: ELLIPSE_95 * Math.sqrt(Math.max(0, mean + spread)),
    minor_m: ELLIPSE_95 * Math.sqrt(Math.max(0, mean - spread)),
    angle_rad: Math.atan2(2 * en, ee - nn) / 2, // of the major axis, from east to north
  };
}
