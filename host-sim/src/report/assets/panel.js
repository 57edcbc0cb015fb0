// The panel: key results with their verdicts, drones, placements, events, and where it all came from.

/** More events than this are not listed; the panel says how many it left out. */
const EVENTS_LISTED = 2000;
/** Least share of the area that counts as covered, allowing for the arithmetic of thin slivers. */
const COVERED_FRACTION = 0.9999;

/** Each result: name, value, note and, where a mission can fail by it, whether it passed. */
function keyResults() {
  const { sweep = {}, localization: found = {}, placement = {}, safety = {}, link = {}, timing = {} } = data.summary;
  const users = found.users;
  const share = (count) => (users > 0 ? formatShare(count / users) : DASH);
  const lengths = (sweep.length_m ?? []).filter(isNumber).map(formatLength).join(" + ");
  return [
    {
      name: "Area covered",
      value: formatShare(sweep.coverage_fraction, 2),
      note: `${lengths || DASH} flown, ${formatClock(sweep.duration_s)} h`,
      passed: isNumber(sweep.coverage_fraction) ? sweep.coverage_fraction >= COVERED_FRACTION : null,
    },
    {
      name: "Users located",
      value: formatNumber(found.located),
      of: `of ${formatNumber(users)}`,
      note: share(found.located),
    },
    {
      name: "95 % radius, median",
      value: formatWith(found.r95_median_m, "m", 1),
      note: `95th percentile ${formatWith(found.r95_p95_m, "m", 1)}, RMS error ${formatWith(found.rmse_m, "m", 1)}`,
    },
    {
      name: "Inside their r95",
      value: formatShare(found.in_r95_fraction),
      note: `expected 95${GAP}%; error ${formatNumber(found.crlb_ratio, 2)}× the Cramér-Rao bound`,
      passed: holdsItsPromise(found),
    },
    {
      name: "Served, guaranteed",
      value: formatNumber(placement.served_guaranteed),
      of: `of ${formatNumber(users)}`,
      note: `${share(placement.served_guaranteed)}; bound ${formatNumber(placement.upper_bound)}${placement.proved_optimal ? ", proved optimal" : ""}`,
    },
    {
      name: "Served, actual",
      value: formatNumber(placement.served_actual),
      of: `of ${formatNumber(users)}`,
      note: `${share(placement.served_actual)} truly within ${formatLength(data.radius_m)}`,
    },
    {
      name: "Least separation",
      value: formatWith(safety.min_separation_m, "m", 1),
      note: `${formatNumber(safety.violations)} violations`,
      passed: isNumber(safety.violations) ? safety.violations === 0 : null,
    },
    {
      name: "Within the fence",
      value: formatWith(safety.min_fence_distance_m, "m", 1),
      note: isNumber(safety.min_obstacle_distance_m)
        ? `obstacles kept at ${formatWith(safety.min_obstacle_distance_m, "m", 1)}`
        : "no obstacles",
      passed: isNumber(safety.min_fence_distance_m) ? safety.min_fence_distance_m >= 0 : null,
    },
    {
      name: "Formation error, RMS",
      value: formatWith(safety.formation_error_rms_m, "m", 2),
      note: `largest ${formatWith(safety.formation_error_max_m, "m", 2)}`,
    },
    {
      name: "Link frames",
      value: formatNumber(link.frames),
      note: `${formatNumber(link.lost)} lost (${formatShare(link.lost / link.frames, 2)}), ${formatNumber(link.rejected)} rejected, ${formatBytes(link.bytes)}`,
    },
    {
      name: "Faster than real time",
      value: isNumber(timing.realtime_factor) ? `${formatNumber(timing.realtime_factor)}×` : DASH,
      note: `${formatClock(timing.simulated_s)} h in ${formatWith(timing.wall_s, "s", 1)}`,
    },
  ];
}

/** Whether the 95 % disks hold 95 % of the users, allowing three standard deviations of chance. */
function holdsItsPromise({ in_r95_fraction, located }) {
  if (!isNumber(in_r95_fraction) || !(located > 0)) return null;
  return in_r95_fraction >= 0.95 - 3 * Math.sqrt((0.95 * 0.05) / located);
}

function verdictMark(passed) {
  if (typeof passed !== "boolean") return "";
  return element("span", { className: `mark ${passed ? "pass" : "fail"}` }, passed ? "✓ pass" : "✗ fail");
}

function resultCard({ name, value, of, note, passed }) {
  const shownValue = element("p", { className: "result-value" }, value);
  if (of) shownValue.append(" ", element("small", {}, of));
  return element(
    "div", {},
    element("p", { className: "result-name" }, element("span", {}, name), verdictMark(passed)),
    shownValue,
    element("p", { className: "result-note" }, note),
  );
}

function buildPanel() {
  const results = keyResults();
  byId("results").append(...results.map(resultCard));
  const limits = Array.isArray(data.summary.limits) ? data.summary.limits : [];
  byId("acceptance").hidden = limits.length === 0;
  byId("acceptance-list").append(...limits.map(limitRow));
  buildMasthead([...results, ...limits.map(({ ok }) => ({ passed: ok }))]);
  buildPlacements();
  buildEvents();
  buildAbout();
}

function limitRow({ name, value, limit, ok }) {
  const show = (x) => (isNumber(x) ? String(Number(x.toPrecision(5))) : String(x ?? DASH));
  return element(
    "div", { className: "limit" },
    element("span", {}, String(name)),
    element("span", {}, `${show(value)} (limit ${show(limit)})`),
    verdictMark(ok),
  );
}

function buildMasthead(checks) {
  byId("scenario").textContent = `Scenario ${data.scenario || DASH}, seed ${data.seed}`;
  const count = (list, one, many) => `${formatNumber(list.length)} ${list.length === 1 ? one : many}`;
  byId("headline").textContent = [
    `${count(data.drones, "drone", "drones")} in ${count(fleets, "fleet", "fleets")}`,
    count(data.users, "user", "users"),
    `area ${formatArea(ringsArea(data.area_m))}`,
    `coverage radius ${formatLength(data.radius_m)}`,
    `${formatClock(data.end_s)} h of mission`,
  ].join(" · ");
  const failed = checks.filter(({ passed }) => passed === false);
  const judged = checks.filter(({ passed }) => typeof passed === "boolean");
  if (judged.length === 0) return;
  byId("verdict").classList.add(failed.length === 0 ? "pass" : "fail");
  byId("verdict").textContent = failed.length === 0
    ? `✓ All ${judged.length} checks passed`
    : `✗ ${failed.length} of ${judged.length} checks failed`;
}

/** Enclosed area; holes run clockwise and count negative. */
function ringsArea(rings_m) {
  const crossed = rings_m.flatMap((corners_m) => corners_m.map(([e, n], i) => {
    const [e2, n2] = corners_m[(i + 1) % corners_m.length];
    return e * n2 - e2 * n;
  }));
  return crossed.reduce((sum, x) => sum + x, 0) / 2;
}

function tableHead(names) {
  return element("thead", {}, element("tr", {}, ...names.map((name) => element("th", { scope: "col" }, name))));
}

function tableRow(cells) {
  return element("tr", {}, ...cells.map((cell) => element("td", {}, cell)));
}

function droneName(id) {
  const dot = element("i", { className: "swatch" });
  const fleet = droneById.get(id)?.fleet ?? null;
  dot.style.background = fleet === null ? "var(--reserve)" : `var(--fleet-${fleet % 6})`;
  const name = element("span", {}, dot, String(id));
  name.title = fleet === null ? "Reserve" : `Fleet ${fleet + 1}`;
  return name;
}

/** A row that shows its drone on the map when clicked. */
function droneRow(id, cells, point) {
  const row = tableRow([droneName(id), ...cells]);
  row.dataset.drone = id;
  row.title = "Show on the map";
  row.addEventListener("click", () => { if (point()) lookAt(point().slice(0, 2), 0.4); });
  return row;
}

const droneCells = new Map();

function buildDrones() {
  const body = element("tbody");
  for (const drone of data.drones) {
    const row = droneRow(drone.id, ["", "", "", ""], () => positionAt(drone, clock.t_s));
    droneCells.set(drone, [...row.children].slice(1));
    body.append(row);
  }
  byId("drones").append(tableHead(["Drone", "East, m", "North, m", "Up, m", "Speed, m/s"]), body);
}

function updateDrones(t_s) {
  byId("drones-at").textContent = `at ${formatClock(t_s)}`;
  for (const [drone, cells] of droneCells) {
    const position = positionAt(drone, t_s) ?? [];
    const texts = [...[0, 1, 2].map((axis) => formatNumber(position[axis], 1)), formatNumber(speedAt(drone, t_s), 1)];
    texts.forEach((text, i) => { if (cells[i].textContent !== text) cells[i].textContent = text; });
  }
}

function buildPlacements() {
  const rows = data.placements.map(({ drone, pos_m, covered }) => {
    const served = data.users.filter((user) => user.actual_by === drone).length;
    const cells = [formatNumber(pos_m[0], 1), formatNumber(pos_m[1], 1), formatNumber(covered), formatNumber(served)];
    return droneRow(drone, cells, () => pos_m);
  });
  byId("placements-aside").textContent = data.summary.placement?.method ?? "";
  byId("placements").append(
    tableHead(["Drone", "East, m", "North, m", "Users planned", "truly served"]),
    element("tbody", {}, ...rows),
  );
}

const eventRows = [];

function buildEvents() {
  byId("events-aside").textContent = formatNumber(data.events.length);
  for (const event of data.events.slice(0, EVENTS_LISTED)) {
    const who = event.drone === null ? "" : `Drone ${event.drone}: `;
    const button = element(
      "button", { type: "button" },
      element("time", {}, formatClock(event.t_s)),
      element("span", {}, who + event.text),
    );
    button.addEventListener("click", () => setTime(event.t_s));
    eventRows.push(button);
    byId("events").append(element("li", {}, button));
  }
  const left = data.events.length - EVENTS_LISTED;
  if (left > 0) byId("events").append(element("li", { className: "note" }, `and ${formatNumber(left)} later ones, not listed`));
}

let eventsPast = -1;

function updateEvents(t_s) {
  const past = eventRows.length && data.events.findLastIndex((event) => event.t_s <= t_s) + 1;
  if (past === eventsPast) return;
  eventsPast = past;
  eventRows.forEach((row, i) => {
    row.classList.toggle("future", i >= past);
    row.classList.toggle("latest", i === past - 1);
  });
  const latest = eventRows[past - 1];
  const list = byId("events");
  if (latest) list.scrollTop = latest.offsetTop - list.offsetTop - list.clientHeight / 2;
}

function buildAbout() {
  const dropped = data.drones.reduce((sum, drone) => sum + drone.dropped, 0);
  const facts = [
    ["Scenario", data.scenario || DASH],
    ["Seed", data.seed],
    ["Backend", data.summary.backend ?? DASH],
    ["Swath", formatWith(data.swath_m, "m", 2)],
    ["Origin", data.origin_lon_lat_deg ? formatLonLat(data.origin_lon_lat_deg) : "local coordinates"],
    ["Tracks", `drawn within 0.35${GAP}m${dropped ? `, ${dropped} unusable samples left out` : ""}`],
    ["Digest", element("code", {}, data.summary.digest ?? DASH)],
  ];
  byId("about").append(element("dl", {}, ...facts.flatMap(([name, value]) => [
    element("dt", {}, name), element("dd", {}, value),
  ])));
}
