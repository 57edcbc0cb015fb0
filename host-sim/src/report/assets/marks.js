// Users, placements and drones at the slider's time.

/** An error ellipse shows once its half axis is this long on the screen. */
const ELLIPSE_LEAST_PX = 7;
/** Drones closer than this share one label. */
const LABEL_GAP_PX = 30;
/** How near the pointer has to be to something to mean it. */
const REACH_PX = 10;

function symbolRadius() {
  const crowd = data.users.length > 2000 ? 0.75 : 1;
  return crowd * Math.min(5.5, Math.max(2.4, 2.4 + 1.1 * Math.log10(view.px_per_m / 0.06)));
}

function isOnStage([x_px, y_px], margin_px) {
  return x_px > -margin_px && y_px > -margin_px && x_px < view.width_px + margin_px && y_px < view.height_px + margin_px;
}

function drawUsers(layer, shown, t_s) {
  const stamp = `${view.version}|${shown.users}|${shown.truth}|${shown.ellipses}|${usersStamp(t_s)}`;
  if (!isStale(layer, stamp)) return;
  if (!shown.users) return;
  const { pen } = layer;
  const conditions = conditionsAt(t_s);
  const visible = [];
  data.users.forEach((user, i) => {
    const at_px = toScreen(...shownAt(user, conditions[i]));
    if (isOnStage(at_px, 60)) visible.push({ user, condition: conditions[i], at_px });
  });
  for (const seen of visible) drawUncertainty(pen, seen, shown.ellipses, shown.truth);
  const r_px = symbolRadius();
  const stamps = new Map([...new Set(conditions)].map((condition) => [condition, symbolStamp(condition, r_px)]));
  for (const { condition, at_px } of visible) stampAt(pen, stamps.get(condition), at_px);
}

/** The user pointed at: a ring, and where it truly is. */
function drawChosen(pen, user, shown, t_s) {
  const condition = conditionOf(user, t_s, stationsAt(t_s));
  const at_px = toScreen(...shownAt(user, condition));
  drawUncertainty(pen, { user, condition, at_px }, !shown.ellipses, true);
  pen.beginPath();
  pen.arc(...at_px, symbolRadius() + 4, 0, 2 * Math.PI);
  pen.strokeStyle = theme.accent;
  pen.lineWidth = 2;
  pen.stroke();
}

/** Error ellipse and true position of a located user, as wanted. */
function drawUncertainty(pen, { user, condition, at_px }, withEllipse, withTruth) {
  if (condition === "pending" || !user.estimate_m) return;
  const { ellipse } = user;
  const major_px = (ellipse?.major_m ?? 0) * view.px_per_m;
  if (ellipse && withEllipse && major_px >= ELLIPSE_LEAST_PX) {
    pen.beginPath();
    pen.ellipse(...at_px, major_px, ellipse.minor_m * view.px_per_m, -ellipse.angle_rad, 0, 2 * Math.PI);
    pen.fillStyle = pen.strokeStyle = userColour(condition);
    pen.globalAlpha = 0.13;
    pen.fill();
    pen.globalAlpha = 0.8;
    pen.lineWidth = 1;
    pen.stroke();
    pen.globalAlpha = 1;
  }
  if (!withTruth) return;
  const [x_px, y_px] = toScreen(...user.truth_m);
  pen.strokeStyle = pen.fillStyle = theme.truth;
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(...at_px);
  pen.lineTo(x_px, y_px);
  pen.stroke();
  pen.beginPath();
  pen.arc(x_px, y_px, Math.max(1.6, symbolRadius() * 0.55), 0, 2 * Math.PI);
  pen.fill();
}

function drawAir(layer, shown, t_s, chosen) {
  const { pen } = layer;
  if (!isStale(layer, `${view.version}|${t_s}|${JSON.stringify(shown)}|${chosen && data.users.indexOf(chosen)}`)) return;
  if (shown.placements && isPlaced(t_s)) for (const placement of data.placements) drawPlacement(pen, placement, t_s);
  if (shown.overlap) for (const fleet of fleets) if (isSweeping(fleet, t_s)) drawOverlap(pen, fleet, t_s);
  if (chosen) drawChosen(pen, chosen, shown, t_s);
  if (shown.drones) drawDrones(pen, t_s);
}

/** A placement's coverage disk: dashed while its drone is on the way. */
function drawPlacement(pen, { drone, pos_m }, t_s) {
  const colour = fleetColour(droneById.get(drone)?.fleet ?? null);
  const isServing = droneById.has(drone) && isOnStation(droneById.get(drone), t_s);
  pen.beginPath();
  traceDisk(pen, pos_m, data.radius_m);
  pen.fillStyle = pen.strokeStyle = colour;
  pen.globalAlpha = isServing ? 0.14 : 0.05;
  pen.fill();
  pen.globalAlpha = 1;
  pen.lineWidth = isServing ? 1.75 : 1.25;
  if (!isServing) pen.setLineDash([5, 4]);
  pen.stroke();
  pen.setLineDash([]);
  const [x_px, y_px] = toScreen(...pos_m);
  pen.beginPath();
  pen.moveTo(x_px - 5, y_px);
  pen.lineTo(x_px + 5, y_px);
  pen.moveTo(x_px, y_px - 5);
  pen.lineTo(x_px, y_px + 5);
  pen.stroke();
}

/** Where all drones of a fleet hear: the intersection of their disks, with the swath's disk inside. */
function drawOverlap(pen, { number, drones }, t_s) {
  const colour = fleetColour(number);
  pen.save();
  for (const drone of drones) {
    pen.beginPath();
    traceDisk(pen, positionAt(drone, t_s), data.radius_m);
    pen.clip();
  }
  pen.globalAlpha = 0.28;
  pen.fillStyle = colour;
  pen.fillRect(0, 0, view.width_px, view.height_px);
  pen.restore();
  const { centre, reach_m } = formationAt(drones, t_s);
  pen.beginPath();
  traceDisk(pen, centre, Math.min(reach_m, data.swath_m / 2));
  pen.strokeStyle = colour;
  pen.lineWidth = 1.25;
  pen.stroke();
}

function drawDrones(pen, t_s) {
  const flying = data.drones.filter((drone) => drone.t_s.length > 0);
  const placed = flying.map((drone) => {
    const [e_m, n_m] = positionAt(drone, t_s);
    return { drone, at_px: toScreen(e_m, n_m) };
  });
  for (const { drone, at_px } of placed) {
    pen.beginPath();
    pen.arc(...at_px, 5, 0, 2 * Math.PI);
    pen.fillStyle = fleetColour(drone.fleet);
    pen.fill();
    pen.strokeStyle = theme.surface;
    pen.lineWidth = 1.5;
    pen.stroke();
  }
  for (const group of groupNear(placed)) drawGroupLabel(pen, group);
}

/** Groups drones whose labels would lie on each other. */
function groupNear(placed) {
  const groups = [];
  for (const one of placed) {
    const near = groups.find((group) =>
      group[0].drone.fleet === one.drone.fleet && distance(group[0].at_px, one.at_px) < LABEL_GAP_PX);
    if (near) near.push(one);
    else groups.push([one]);
  }
  return groups;
}

function drawGroupLabel(pen, group) {
  const text = (group.length > 1 ? "Drones " : "Drone ") + group.map(({ drone }) => drone.id).join(" ");
  const x_px = group.reduce((sum, { at_px }) => sum + at_px[0], 0) / group.length;
  const top_px = Math.min(...group.map(({ at_px }) => at_px[1]));
  drawLabel(pen, text, x_px, top_px - 17, fleetColour(group[0].drone.fleet));
}

/** The drone or, failing that, the user nearest to a pixel, within reach. */
function findNear(at_px, shown, t_s) {
  const near = { gap_px: REACH_PX, drone: null, user: null };
  const consider = (found, position_m) => {
    const gap_px = distance(toScreen(position_m[0], position_m[1]), at_px);
    if (gap_px < near.gap_px) Object.assign(near, { drone: null, user: null, ...found, gap_px });
  };
  if (shown.drones) {
    for (const drone of data.drones) {
      const position = positionAt(drone, t_s);
      if (position) consider({ drone }, position);
    }
  }
  if (near.drone || !shown.users) return near;
  const conditions = conditionsAt(t_s);
  data.users.forEach((user, i) => consider({ user }, shownAt(user, conditions[i])));
  return near;
}
