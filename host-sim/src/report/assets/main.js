// Ties the page together: one draw request at a time, whatever changed.

const layers = {
  ground: addLayer("ground"),
  swept: addLayer("swept"),
  flown: addLayer("flown"),
  users: addLayer("users"),
  air: addLayer("air"),
};
const pointed = { user: null, drone: null, pinned: false };
/** While the mission plays, users and figures change no faster than an eye can follow; drones do every frame. */
const FIGURES_EVERY_MS = 120;
const figures = { t_s: 0, updated_ms: -Infinity };
let drawRequested = false;

function requestDraw() {
  if (drawRequested) return;
  drawRequested = true;
  requestAnimationFrame(draw);
}

function draw(now_ms) {
  drawRequested = false;
  tick(now_ms);
  const { t_s } = clock;
  drawGround(layers.ground, shown);
  drawSwept(layers.swept, shown, t_s);
  drawFlown(layers.flown, shown, t_s);
  if (!clock.playing || now_ms - figures.updated_ms > FIGURES_EVERY_MS) updateFigures(t_s, now_ms);
  drawUsers(layers.users, shown, figures.t_s);
  drawAir(layers.air, shown, t_s, pointed.user);
  updateTimeline();
  showTip();
}

function updateFigures(t_s, now_ms) {
  Object.assign(figures, { t_s, updated_ms: now_ms });
  updateLegend(t_s);
  updateDrones(t_s);
  updateEvents(t_s);
}

/** Draws everything again, in the colours of now. */
function repaint() {
  readTheme();
  paintSwatches();
  drawTicks();
  for (const layer of Object.values(layers)) layer.key = null;
  moved();
}

function hover(at_px) {
  byId("readout").textContent = at_px ? readoutOf(toGround(...at_px)) : "";
  if (pointed.pinned) return;
  const near = at_px ? findNear(at_px, shown, clock.t_s) : { user: null, drone: null };
  if (near.user === pointed.user && near.drone === pointed.drone) return;
  Object.assign(pointed, { user: near.user, drone: near.drone });
  stage.classList.toggle("pointing", Boolean(near.user || near.drone));
  requestDraw();
}

/** A click keeps what it hits chosen; a click on nothing lets go. */
function choose(at_px) {
  const { user, drone } = findNear(at_px, shown, clock.t_s);
  Object.assign(pointed, { user, drone, pinned: Boolean(user || drone) });
  requestDraw();
}

function readoutOf([e_m, n_m]) {
  const local = `E ${formatWith(e_m, "m")}  N ${formatWith(n_m, "m")}`;
  return data.origin_lon_lat_deg ? `${local}  ·  ${formatLonLat(lonLatOf(e_m, n_m, data.origin_lon_lat_deg))}` : local;
}

function showTip() {
  const tip = byId("tip");
  tip.hidden = !pointed.user && !pointed.drone;
  if (tip.hidden) return;
  const { title, facts, at_m } = pointed.drone ? droneFacts(pointed.drone) : userFacts(pointed.user);
  tip.replaceChildren(
    element("b", {}, title),
    element("dl", {}, ...facts.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)])),
  );
  const [x_px, y_px] = toScreen(at_m[0], at_m[1]);
  const gap_px = 16 + Math.min((pointed.user?.ellipse?.major_m ?? 0) * view.px_per_m, 160);
  const right_px = byId("layers").open ? byId("layers").offsetLeft : view.width_px;
  const fitsRight = x_px + gap_px + tip.offsetWidth <= right_px;
  const left_px = fitsRight ? x_px + gap_px : x_px - gap_px - tip.offsetWidth;
  const top_px = Math.min(Math.max(y_px - tip.offsetHeight / 2, 8), view.height_px - tip.offsetHeight - 8);
  tip.style.left = `${Math.max(left_px, 8)}px`;
  tip.style.top = `${top_px}px`;
}

function userFacts(user) {
  const condition = conditionOf(user, clock.t_s, stationsAt(clock.t_s));
  const named = (id) => (id === null ? "no drone" : `drone ${id}`);
  const known = condition !== "pending";
  const facts = [["State", CONDITIONS.find(([name]) => name === condition)?.[1] ?? condition]];
  if (known) {
    facts.push(
      ["95 % radius", formatWith(user.r95_m, "m", 2)],
      ["True error", formatWith(user.error_m, "m", 2)],
      ["Served by", `${named(user.guaranteed_by)} (guaranteed)`],
      ["", `${named(user.actual_by)} (actual)`],
      ["Occasions", formatNumber(user.occasions)],
    );
  }
  facts.push(["Last heard", user.heard_s === null ? "never" : `${formatClock(user.heard_s)} h`]);
  return { title: `User ${user.id}`, facts, at_m: shownAt(user, condition) };
}

function droneFacts(drone) {
  const at_m = positionAt(drone, clock.t_s);
  const facts = [
    ["Fleet", drone.fleet === null ? "reserve" : String(drone.fleet + 1)],
    ["East", formatWith(at_m[0], "m", 1)],
    ["North", formatWith(at_m[1], "m", 1)],
    ["Up", formatWith(at_m[2], "m", 1)],
    ["Speed", formatWith(speedAt(drone, clock.t_s), "m/s", 1)],
  ];
  if (isOnStation(drone, clock.t_s)) facts.push(["State", "on station"]);
  return { title: `Drone ${drone.id}`, facts, at_m };
}

function findUser(event) {
  event.preventDefault();
  const wanted = byId("find-id").value.trim();
  const user = data.users.find(({ id }) => id === wanted);
  byId("find-note").textContent = user ? "" : `No user is named “${wanted}”.`;
  if (!user) return;
  Object.assign(pointed, { user, drone: null, pinned: true });
  lookAt(shownAt(user, conditionOf(user, clock.t_s, stationsAt(clock.t_s))), 1.5);
}

function stateNow() {
  const stations = stationsAt(clock.t_s);
  return {
    t_s: clock.t_s,
    end_s: data.end_s,
    playing: clock.playing,
    phase: data.phases[phaseIndexAt(clock.t_s)]?.name ?? null,
    px_per_m: view.px_per_m,
    users: countUsers(clock.t_s),
    drones: data.drones.map((drone) => {
      const enu_m = positionAt(drone, clock.t_s);
      const screen_px = enu_m && toScreen(enu_m[0], enu_m[1]);
      return { id: drone.id, fleet: drone.fleet, enu_m, screen_px, on_station: stations.has(drone.id) };
    }),
  };
}

function followSurroundings() {
  new ResizeObserver(() => {
    resize();
    layOutPhases();
    drawTicks();
  }).observe(stage);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  // Paper is white: print in the light colours.
  window.addEventListener("beforeprint", () => {
    document.documentElement.dataset.theme = "light";
    repaint();
    draw(performance.now());
  });
  window.addEventListener("afterprint", () => {
    delete document.documentElement.dataset.theme;
    repaint();
  });
}

readTheme();
buildLegend();
paintSwatches();
buildTimeline();
buildPanel();
buildDrones();
attachGestures(hover, choose);
byId("zoom-in").addEventListener("click", () => zoomCentre(ZOOM_STEP));
byId("zoom-out").addEventListener("click", () => zoomCentre(1 / ZOOM_STEP));
byId("zoom-fit").addEventListener("click", fit);
byId("find").addEventListener("submit", findUser);
followSurroundings();
resize();
window.skyroost = { setTime, state: stateNow };
