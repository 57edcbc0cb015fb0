// What the mission looks like at a time: positions, phases, who serves whom. Nothing here draws.

/** A drone this close to its placement, horizontally, is on station. */
const STATION_M = 15;
/** A fleet's centre this close to the start of its first lane has arrived there. */
const ARRIVAL_M = 60;
/** Spacing of the fleet centre's track, from which the swept ground is drawn. */
const CENTRE_STEP_S = 5;
const CENTRE_TOLERANCE_M = 3;

const CONDITIONS = [
  ["pending", "not heard yet"],
  ["guaranteed", "served, guaranteed"],
  ["actual", "served, no guarantee"],
  ["ok", "located"],
  ["ambiguous", "ambiguous"],
  ["poor_geometry", "poor geometry"],
  ["inconsistent", "inconsistent"],
  ["not_located", "not located"],
];

const data = readData();
const placementOf = new Map(data.placements.map((placement) => [placement.drone, placement]));
const droneById = new Map(data.drones.map((drone) => [drone.id, drone]));
const fleets = gatherFleets();

/** Number of entries of a rising list that are at most `x`. */
function countUpTo(rising, x) {
  let low = 0;
  let high = rising.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rising[middle] <= x) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** East, north, up at a time; the first or last sample outside the track; none without a track. */
function positionAt(drone, t_s) {
  const count = drone.t_s.length;
  if (count === 0) return null;
  const next = Math.min(Math.max(countUpTo(drone.t_s, t_s), 1), count - 1);
  const last = Math.max(next - 1, 0);
  const span_s = drone.t_s[next] - drone.t_s[last];
  const part = span_s > 0 ? Math.min(Math.max((t_s - drone.t_s[last]) / span_s, 0), 1) : 0;
  const mix = (x) => x[last] + part * (x[next] - x[last]);
  return [mix(drone.e_m), mix(drone.n_m), mix(drone.u_m)];
}

/** Speed over the last second, metres per second. */
function speedAt(drone, t_s) {
  const now = positionAt(drone, t_s);
  const before = positionAt(drone, t_s - 1);
  return now && Math.hypot(...now.map((x, axis) => x - before[axis]));
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

function isSweeping(fleet, t_s) {
  return fleet.centre.length > 0 && t_s >= fleet.centre[0].t_s && t_s < data.sweep_s[1];
}

/** Placements are known once the sweep is over. */
function isPlaced(t_s) {
  return t_s >= data.sweep_s[1];
}

function isOnStation(drone, t_s) {
  const placement = placementOf.get(drone.id);
  const position = positionAt(drone, t_s);
  return isPlaced(t_s) && Boolean(placement && position) && distance(position, placement.pos_m) <= STATION_M;
}

function phaseIndexAt(t_s) {
  return data.phases.findLastIndex((phase) => phase.t_s <= t_s);
}

/** Identifiers of the drones on station. */
function stationsAt(t_s) {
  return new Set(data.drones.filter((drone) => isOnStation(drone, t_s)).map((drone) => drone.id));
}

/** One of `CONDITIONS`, or the status itself where it is none of them. */
function conditionOf(user, t_s, stations) {
  if (user.appears_s > t_s) return "pending";
  if (user.status !== "ok") return user.status;
  if (stations.has(user.guaranteed_by)) return "guaranteed";
  return stations.has(user.actual_by) ? "actual" : "ok";
}

/** Where a user is drawn: at the estimate once there is one, else at the truth, which only a simulation knows. */
function shownAt(user, condition) {
  return condition === "pending" || !user.estimate_m ? user.truth_m : user.estimate_m;
}

/** Changes exactly when some user's condition may change. */
function usersStamp(t_s) {
  return `${countUpTo(data.appearances_s, t_s)}|${[...stationsAt(t_s)]}`;
}

function conditionsAt(t_s) {
  const stations = stationsAt(t_s);
  return data.users.map((user) => conditionOf(user, t_s, stations));
}

/** Fleets with their drones and the track of their centre over the lanes. */
function gatherFleets() {
  const numbers = new Set(data.sub_areas.map((area) => area.fleet));
  for (const drone of data.drones) if (drone.fleet !== null) numbers.add(drone.fleet);
  return [...numbers].sort((a, b) => a - b).map((number) => {
    const drones = data.drones.filter((drone) => drone.fleet === number && drone.t_s.length > 0);
    const lanes = data.sub_areas.find((area) => area.fleet === number)?.path_m ?? [];
    return { number, drones, centre: centreTrack(drones, lanes) };
  });
}

/** Centre of a formation and the radius of the disk around it that all its drones cover. */
function formationAt(drones, t_s) {
  const positions = drones.map((drone) => positionAt(drone, t_s));
  const centre = [0, 1].map((axis) => positions.reduce((sum, p) => sum + p[axis], 0) / positions.length);
  const reach_m = data.radius_m - Math.max(...positions.map((p) => distance(p, centre)));
  return { t_s, centre, reach_m: Math.max(0, reach_m) };
}

/** From the formation's arrival at its first lane, since the way there sweeps nothing, to the sweep's end. */
function centreTrack(drones, lanes) {
  const track = [];
  if (drones.length === 0) return track;
  const [start_s, end_s] = data.sweep_s;
  for (let t_s = lanes.length > 0 ? 0 : start_s; t_s < end_s; t_s += CENTRE_STEP_S) track.push(formationAt(drones, t_s));
  track.push(formationAt(drones, end_s));
  const arrival = track.findIndex(({ centre }) => lanes.length > 0 && distance(centre, lanes[0]) <= ARRIVAL_M);
  return thin(arrival >= 0 ? track.slice(arrival) : track.filter(({ t_s }) => t_s >= start_s));
}

/** Leaves out what lies on the straight flight between its neighbours, so that a lane is one stroke. */
function thin(track) {
  const kept = track.slice(0, 1);
  let anchor = 0;
  for (let i = 2; i < track.length; i += 1) {
    if (isStraight(track, anchor, i)) continue;
    anchor = i - 1;
    kept.push(track[anchor]);
  }
  if (track.length > 1) kept.push(track[track.length - 1]);
  return kept;
}

function isStraight(track, from, to) {
  const [a, b] = [track[from], track[to]];
  return track.slice(from + 1, to).every(({ t_s, centre, reach_m }) => {
    const part = (t_s - a.t_s) / (b.t_s - a.t_s);
    const mix = (x, y) => x + part * (y - x);
    const straight = [mix(a.centre[0], b.centre[0]), mix(a.centre[1], b.centre[1])];
    return distance(centre, straight) <= CENTRE_TOLERANCE_M
      && Math.abs(reach_m - mix(a.reach_m, b.reach_m)) <= CENTRE_TOLERANCE_M;
  });
}
