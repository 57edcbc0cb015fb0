// The ground: grid, area, no-fly zones, sub-areas, planned lanes, and what stayed uncovered.

const GRID_MOST_PX = 150;
const SCALE_MOST_PX = 150;

/** The largest 1, 2 or 5 times a power of ten that is at most `x`. */
function roundDown(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return [5, 2, 1].find((digit) => digit * power <= x) * power;
}

function drawGround(layer, shown) {
  const { plan, noFly, uncovered, grid } = shown;
  if (!isStale(layer, [view.version, plan, noFly, uncovered, grid].join("|"))) return;
  const { pen } = layer;
  drawArea(pen);
  if (grid) drawGrid(pen);
  outlineArea(pen);
  drawFence(pen);
  if (noFly) drawNoFly(pen);
  if (plan) drawPlan(pen);
  if (uncovered) drawUncovered(pen);
  drawScale();
}

function drawArea(pen) {
  pen.beginPath();
  for (const ring_m of data.area_m) tracePolygon(pen, ring_m);
  pen.fillStyle = theme["map-area"];
  pen.fill("evenodd");
  for (const { fleet, polygon_m } of data.sub_areas) {
    if (!polygon_m) continue;
    pen.beginPath();
    tracePolygon(pen, polygon_m);
    pen.fillStyle = fleetColour(fleet);
    pen.globalAlpha = 0.06;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = fleetColour(fleet);
    pen.lineWidth = 1;
    pen.setLineDash([2, 4]);
    pen.stroke();
    pen.setLineDash([]);
  }
}

function outlineArea(pen) {
  pen.beginPath();
  for (const ring_m of data.area_m) tracePolygon(pen, ring_m);
  pen.strokeStyle = theme.outline;
  pen.lineWidth = 1.5;
  pen.stroke();
}

function drawFence(pen) {
  if (data.fence_m.length === 0) return;
  pen.beginPath();
  tracePolygon(pen, data.fence_m);
  pen.strokeStyle = theme["no-fly"];
  pen.lineWidth = 1;
  pen.setLineDash([8, 5]);
  pen.stroke();
  pen.setLineDash([]);
}

function drawGrid(pen) {
  const step = roundDown(GRID_MOST_PX / view.px_per_m);
  const [west_m, north_m] = toGround(0, 0);
  const [east_m, south_m] = toGround(view.width_px, view.height_px);
  pen.strokeStyle = theme.grid;
  pen.fillStyle = theme.muted;
  pen.lineWidth = 1;
  pen.font = `11px ${theme.font}`;
  pen.textBaseline = "top";
  pen.textAlign = "center";
  pen.beginPath();
  for (let i = Math.ceil(west_m / step); i * step <= east_m; i += 1) {
    const x_px = Math.round(toScreen(i * step, 0)[0]) + 0.5;
    pen.moveTo(x_px, 0);
    pen.lineTo(x_px, view.height_px);
    if (x_px > 90) pen.fillText(gridText(i, step), x_px, 5);
  }
  pen.textBaseline = "middle";
  pen.textAlign = "left";
  for (let i = Math.ceil(south_m / step); i * step <= north_m; i += 1) {
    const y_px = Math.round(toScreen(0, i * step)[1]) + 0.5;
    pen.moveTo(0, y_px);
    pen.lineTo(view.width_px, y_px);
    if (y_px > 130 && y_px < view.height_px - 50) pen.fillText(gridText(i, step), 6, y_px - 8);
  }
  pen.stroke();
}

function gridText(i, step_m) {
  const unit = step_m >= 1000 ? [1000, "km"] : [1, "m"];
  return `${formatNumber((i * step_m) / unit[0], step_m < 1 ? 1 : 0)}${GAP}${unit[1]}`;
}

function drawPlan(pen) {
  for (const { fleet, path_m } of data.sub_areas) {
    pen.beginPath();
    tracePath(pen, path_m);
    pen.strokeStyle = fleetColour(fleet);
    pen.globalAlpha = 0.45;
    pen.lineWidth = 1;
    pen.setLineDash([7, 4]);
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }
}

function drawNoFly(pen) {
  drawHatched(pen, data.no_fly_m, theme["no-fly"]);
}

function drawUncovered(pen) {
  drawHatched(pen, data.uncovered_m, theme.uncovered);
}

function drawHatched(pen, rings_m, colour) {
  if (rings_m.length === 0) return;
  pen.beginPath();
  for (const ring_m of rings_m) tracePolygon(pen, ring_m);
  pen.fillStyle = hatch(pen, colour);
  pen.fill();
  pen.strokeStyle = colour;
  pen.lineWidth = 1.25;
  pen.stroke();
}

function drawScale() {
  const length_m = roundDown(SCALE_MOST_PX / view.px_per_m);
  byId("scale-bar").style.width = `${length_m * view.px_per_m}px`;
  byId("scale-text").textContent = formatStep(length_m);
}
