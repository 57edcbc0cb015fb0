// What was flown up to the slider: the ground swept and the drones' tracks. While the mission plays,
// only the new stretch is added; a jump back or a moved map draws all of it anew.

/** Screen steps shorter than this are left out of a track. */
const TRACK_STEP_PX = 0.7;

function drawFlown(layer, shown, t_s) {
  const from_s = beginStretch(layer, `${view.version}|${shown.tracks}`, t_s);
  if (from_s === null || !shown.tracks) return;
  for (const drone of data.drones) drawTrack(layer.pen, drone, from_s, t_s);
}

function drawSwept(layer, shown, t_s) {
  layer.canvas.classList.toggle("past", isPlaced(t_s)); // steps back behind the placements
  const from_s = beginStretch(layer, `${view.version}|${shown.swept}`, t_s);
  if (from_s === null || !shown.swept) return;
  for (const fleet of fleets) drawSweptBy(layer.pen, fleet, from_s, t_s);
}

/** From when on a layer has to be drawn up to `t_s`; none if it already is. */
function beginStretch(layer, key, t_s) {
  const whole = layer.drawn_s === undefined || layer.drawn_s > t_s || layer.key !== key;
  const from_s = whole ? -Infinity : layer.drawn_s;
  if (whole) {
    layer.key = null;
    isStale(layer, key);
  }
  layer.drawn_s = t_s;
  return from_s < t_s ? from_s : null;
}

function drawTrack(pen, drone, from_s, to_s) {
  const first = positionAt(drone, Math.max(from_s, drone.t_s[0] ?? 0));
  if (!first) return;
  pen.beginPath();
  let [x_px, y_px] = toScreen(first[0], first[1]);
  pen.moveTo(x_px, y_px);
  const end = countUpTo(drone.t_s, to_s);
  for (let i = countUpTo(drone.t_s, from_s); i < end; i += 1) {
    const [nextX_px, nextY_px] = toScreen(drone.e_m[i], drone.n_m[i]);
    if (Math.abs(nextX_px - x_px) + Math.abs(nextY_px - y_px) < TRACK_STEP_PX) continue;
    [x_px, y_px] = [nextX_px, nextY_px];
    pen.lineTo(x_px, y_px);
  }
  const last = positionAt(drone, to_s);
  pen.lineTo(...toScreen(last[0], last[1]));
  pen.strokeStyle = fleetColour(drone.fleet);
  pen.lineWidth = drone.fleet === null ? 1.5 : 1.3;
  pen.lineJoin = "round";
  if (drone.fleet === null) dashFrom(pen, drone, from_s);
  pen.stroke();
  pen.setLineDash([]);
  pen.lineDashOffset = 0;
}

/** Dashes of a reserve's track; the offset lets a stretch go on where the last one stopped. */
function dashFrom(pen, drone, from_s) {
  pen.setLineDash([6, 5]);
  let length_m = 0;
  const end = countUpTo(drone.t_s, from_s);
  for (let i = 1; i < end; i += 1) {
    length_m += Math.hypot(drone.e_m[i] - drone.e_m[i - 1], drone.n_m[i] - drone.n_m[i - 1]);
  }
  if (end > 0) length_m += distance(positionAt(drone, from_s), [drone.e_m[end - 1], drone.n_m[end - 1]]);
  pen.lineDashOffset = length_m * view.px_per_m;
}

/** The disks around the fleet's centre that all its drones cover, as one wide stroke per stretch. */
function drawSweptBy(pen, { number, centre }, from_s, to_s) {
  pen.strokeStyle = fleetColour(number);
  pen.lineCap = "round";
  pen.lineJoin = "round";
  for (let i = 1; i < centre.length; i += 1) {
    const [a, b] = [centre[i - 1], centre[i]];
    if (b.t_s <= from_s) continue;
    if (a.t_s >= to_s) break;
    const part = Math.min(1, (to_s - a.t_s) / (b.t_s - a.t_s));
    const end = [0, 1].map((axis) => a.centre[axis] + part * (b.centre[axis] - a.centre[axis]));
    pen.lineWidth = 2 * Math.min(a.reach_m, b.reach_m) * view.px_per_m;
    if (pen.lineWidth === 0 || Math.min(a.reach_m, b.reach_m) === 0) continue;
    pen.beginPath();
    tracePath(pen, [a.centre, end]);
    pen.stroke();
  }
}
