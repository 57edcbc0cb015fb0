// Layer switches that are the legend at the same time, with live counts of the users.

const LAYERS = [
  { name: "users", title: "Users", on: true, sample: (pen) => sampleSymbol(pen, "ok") },
  { name: "ellipses", title: "95 % ellipses (zoom in)", on: true, sample: sampleEllipse },
  { name: "truth", title: "True positions", on: false, sample: sampleTruth },
  { name: "drones", title: "Drones", on: true, sample: sampleDrone },
  { name: "tracks", title: "Tracks flown", on: true, sample: (pen) => sampleLines(pen, []) },
  { name: "swept", title: "Ground swept", on: true, sample: (pen) => sampleFill(pen, 0.25) },
  { name: "overlap", title: "Overlap coverage", on: true, sample: (pen) => sampleFill(pen, 0.5) },
  { name: "plan", title: "Lanes planned", on: true, sample: (pen) => sampleLines(pen, [4, 3]) },
  { name: "placements", title: "Placements", on: true, sample: samplePlacement },
  { name: "uncovered", title: "Left uncovered", on: true, sample: (pen) => sampleHatched(pen, "uncovered") },
  { name: "noFly", title: "No-fly zones", on: true, sample: (pen) => sampleHatched(pen, "no-fly") },
  { name: "grid", title: "Grid", on: true, sample: sampleGrid },
];

const shown = Object.fromEntries(LAYERS.map(({ name, on }) => [name, on]));
const samples = []; // every swatch with its painter, to paint again when the theme changes
const counters = new Map();

function sampleSymbol(pen, condition) {
  pen.beginPath();
  traceSymbol(pen, condition, 11, 8, 4);
  paintSymbols(pen, condition, 4);
}

function sampleEllipse(pen) {
  pen.beginPath();
  pen.ellipse(11, 8, 9, 5, -0.4, 0, 2 * Math.PI);
  pen.strokeStyle = pen.fillStyle = theme["user-ok"];
  pen.globalAlpha = 0.13;
  pen.fill();
  pen.globalAlpha = 1;
  pen.stroke();
}

function sampleTruth(pen) {
  pen.strokeStyle = pen.fillStyle = theme.truth;
  pen.beginPath();
  pen.moveTo(4, 11);
  pen.lineTo(16, 6);
  pen.stroke();
  pen.beginPath();
  pen.arc(16, 6, 2.4, 0, 2 * Math.PI);
  pen.fill();
}

function fleetNumbers() {
  return fleets.slice(0, 2).map(({ number }) => number);
}

function sampleDrone(pen) {
  fleetNumbers().forEach((fleet, i, { length }) => {
    pen.beginPath();
    pen.arc(length > 1 ? 6.5 + 9 * i : 11, 8, 4, 0, 2 * Math.PI);
    pen.fillStyle = fleetColour(fleet);
    pen.fill();
  });
}

function sampleLines(pen, dash) {
  pen.setLineDash(dash);
  fleetNumbers().forEach((fleet, i) => {
    pen.beginPath();
    pen.moveTo(1, 5.5 + 5 * i);
    pen.lineTo(21, 5.5 + 5 * i);
    pen.strokeStyle = fleetColour(fleet);
    pen.lineWidth = 1.5;
    pen.stroke();
  });
  pen.setLineDash([]);
}

function sampleFill(pen, alpha) {
  pen.globalAlpha = alpha;
  fleetNumbers().forEach((fleet, i, { length }) => {
    pen.fillStyle = fleetColour(fleet);
    pen.fillRect(2 + (18 / length) * i, 2, 18 / length, 12);
  });
  pen.globalAlpha = 1;
}

function samplePlacement(pen) {
  pen.strokeStyle = pen.fillStyle = fleetColour(fleetNumbers()[0] ?? null);
  pen.beginPath();
  pen.arc(11, 8, 6.5, 0, 2 * Math.PI);
  pen.globalAlpha = 0.16;
  pen.fill();
  pen.globalAlpha = 1;
  pen.stroke();
}

function sampleHatched(pen, colour) {
  pen.fillStyle = hatch(pen, theme[colour]);
  pen.fillRect(2, 2, 18, 12);
  pen.strokeStyle = theme[colour];
  pen.strokeRect(2.5, 2.5, 17, 11);
}

function sampleGrid(pen) {
  pen.strokeStyle = theme.muted;
  pen.globalAlpha = 0.5;
  pen.strokeRect(2.5, 2.5, 8.5, 5.5);
  pen.strokeRect(11, 8, 8.5, 5.5);
  pen.strokeRect(2.5, 8, 8.5, 5.5);
  pen.strokeRect(11, 2.5, 8.5, 5.5);
  pen.globalAlpha = 1;
}

function swatch(paint) {
  const canvas = element("canvas");
  samples.push({ canvas, paint });
  return canvas;
}

function paintSwatches() {
  for (const { canvas, paint } of samples) paint(clearCanvas(canvas, 22, 16));
}

function buildLegend() {
  const list = byId("layer-list");
  for (const layer of LAYERS) {
    list.append(layerRow(layer));
    if (layer.name === "users") for (const condition of presentConditions()) list.append(conditionRow(condition));
  }
  for (const fleet of fleets) {
    const paint = (pen) => sampleFleet(pen, fleet.number);
    list.append(plainRow(paint, `Fleet ${fleet.number + 1}`, `${fleet.drones.length} drones`));
  }
  if (data.drones.some((drone) => drone.fleet === null)) {
    list.append(plainRow((pen) => sampleFleet(pen, null), "Reserve", ""));
  }
  byId("layers").open = window.innerWidth > 760;
}

function sampleFleet(pen, fleet) {
  pen.strokeStyle = fleetColour(fleet);
  pen.lineWidth = 3;
  if (fleet === null) pen.setLineDash([4, 3]);
  pen.beginPath();
  pen.moveTo(2, 8);
  pen.lineTo(20, 8);
  pen.stroke();
  pen.setLineDash([]);
}

/** The conditions some user of this mission can be in. */
function presentConditions() {
  const statuses = new Set(data.users.map((user) => user.status));
  const always = new Set(["pending", "guaranteed", "actual", "ok"]);
  return CONDITIONS.filter(([name]) => always.has(name) || statuses.has(name));
}

function layerRow({ name, title, sample }) {
  const box = element("input", { type: "checkbox", checked: shown[name], name: `layer-${name}` });
  box.addEventListener("change", () => {
    shown[name] = box.checked;
    requestDraw();
  });
  const drawn = { uncovered: data.uncovered_m, noFly: data.no_fly_m }[name];
  const text = drawn?.length === 0 ? `${title} (none)` : title;
  return element("label", { className: "layer" }, box, swatch(sample), text);
}

function conditionRow([name, title]) {
  const count = element("span");
  const row = plainRow((pen) => sampleSymbol(pen, name), title, count);
  counters.set(name, { row, count });
  return row;
}

function plainRow(paint, title, right) {
  return element("div", { className: "legend-row" }, swatch(paint), element("span", {}, title), right);
}

/** Counts of the users by condition at a time. */
function countUsers(t_s) {
  const counts = Object.fromEntries(CONDITIONS.map(([name]) => [name, 0]));
  for (const condition of conditionsAt(t_s)) counts[condition] = (counts[condition] ?? 0) + 1;
  return counts;
}

let countedStamp = null;

function updateLegend(t_s) {
  const stamp = usersStamp(t_s);
  if (stamp === countedStamp) return;
  countedStamp = stamp;
  const counts = countUsers(t_s);
  for (const [name, { row, count }] of counters) {
    count.textContent = formatNumber(counts[name]);
    row.classList.toggle("none", counts[name] === 0);
  }
}
