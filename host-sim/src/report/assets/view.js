// The map's camera: where local metres fall on the screen, and the gestures that move it.

const LEAST_PX_PER_M = 1e-4;
const MOST_PX_PER_M = 40;
const ZOOM_STEP = 1.6;
/** Free border around everything when fitted. */
const FIT_MARGIN_PX = 28;
/** A press that moves less is a click. */
const CLICK_PX = 4;

const stage = byId("stage");

const view = {
  centre_m: [0, 0],
  px_per_m: 0.05,
  width_px: 1,
  height_px: 1,
  fitted: true, // stays fitted while the window changes size, until someone moves the map
  version: 0, // changes with every move, so that layers know when to draw anew
};

function toScreen(e_m, n_m) {
  return [
    (e_m - view.centre_m[0]) * view.px_per_m + view.width_px / 2,
    view.height_px / 2 - (n_m - view.centre_m[1]) * view.px_per_m,
  ];
}

function toGround(x_px, y_px) {
  return [
    (x_px - view.width_px / 2) / view.px_per_m + view.centre_m[0],
    (view.height_px / 2 - y_px) / view.px_per_m + view.centre_m[1],
  ];
}

function moved() {
  view.version += 1;
  requestDraw();
}

/** Zooms so that the ground under the given pixel stays there. */
function zoomAt(x_px, y_px, factor) {
  const [e_m, n_m] = toGround(x_px, y_px);
  view.px_per_m = Math.min(Math.max(view.px_per_m * factor, LEAST_PX_PER_M), MOST_PX_PER_M);
  const [e2_m, n2_m] = toGround(x_px, y_px);
  view.centre_m = [view.centre_m[0] + e_m - e2_m, view.centre_m[1] + n_m - n2_m];
  view.fitted = false;
  moved();
}

function zoomCentre(factor) {
  zoomAt(view.width_px / 2, view.height_px / 2, factor);
}

function panBy(dx_px, dy_px) {
  view.centre_m = [view.centre_m[0] - dx_px / view.px_per_m, view.centre_m[1] + dy_px / view.px_per_m];
  view.fitted = false;
  moved();
}

function lookAt(point_m, px_per_m) {
  view.centre_m = [...point_m];
  view.px_per_m = Math.max(view.px_per_m, px_per_m);
  view.fitted = false;
  moved();
}

/** Shows everything, beside the legend where there is room. */
function fit() {
  const { west, south, east, north } = worldBounds();
  const layers = byId("layers");
  const beside_px = layers.open && view.width_px > 760 ? layers.offsetWidth + 12 : 0;
  const left_px = 52; // zoom buttons
  const free_px = [view.width_px - beside_px - left_px - FIT_MARGIN_PX, view.height_px - 2 * FIT_MARGIN_PX];
  const size_m = [Math.max(east - west, 1), Math.max(north - south, 1)];
  view.px_per_m = Math.min(Math.max(free_px[0], 50) / size_m[0], Math.max(free_px[1], 50) / size_m[1]);
  const shift_m = (beside_px + FIT_MARGIN_PX - left_px) / 2 / view.px_per_m;
  view.centre_m = [(west + east) / 2 + shift_m, (south + north) / 2];
  view.fitted = true;
  moved();
}

/** The box around area, tracks, placements and users; the area alone would hide a base outside it. */
function worldBounds() {
  const box = { west: Infinity, south: Infinity, east: -Infinity, north: -Infinity };
  const take = ([e_m, n_m]) => {
    box.west = Math.min(box.west, e_m);
    box.east = Math.max(box.east, e_m);
    box.south = Math.min(box.south, n_m);
    box.north = Math.max(box.north, n_m);
  };
  data.area_m.flat().forEach(take);
  for (const { path_m } of data.sub_areas) path_m.forEach(take);
  for (const { pos_m } of data.placements) take(pos_m);
  for (const user of data.users) take(user.truth_m);
  for (const drone of data.drones) drone.t_s.forEach((_, i) => take([drone.e_m[i], drone.n_m[i]]));
  return Number.isFinite(box.west) ? box : { west: 0, south: 0, east: 1000, north: 1000 };
}

function resize() {
  view.width_px = Math.max(stage.clientWidth, 1);
  view.height_px = Math.max(stage.clientHeight, 1);
  if (view.fitted) fit();
  else moved();
}

/** Drag to move, wheel or pinch to zoom, click to choose. */
function attachGestures(onHover, onClick) {
  const down = new Map(); // pointers held, by identifier
  let travelled_px = 0;

  const at = (event) => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const isMap = (event) => !event.target.closest("button, details");

  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !isMap(event)) return;
    stage.setPointerCapture(event.pointerId);
    down.set(event.pointerId, at(event));
    if (down.size === 1) travelled_px = 0;
  });
  stage.addEventListener("pointermove", (event) => {
    const now = at(event);
    const before = down.get(event.pointerId);
    if (!before) {
      onHover(isMap(event) ? now : null);
      return;
    }
    const [dx_px, dy_px] = [now[0] - before[0], now[1] - before[1]];
    travelled_px += Math.hypot(dx_px, dy_px);
    if (down.size === 1 && travelled_px > CLICK_PX) {
      stage.classList.add("dragging");
      panBy(dx_px, dy_px);
    } else if (down.size === 2) {
      pinch(down, event.pointerId, now);
    }
    if (down.size > 1 || travelled_px > CLICK_PX) down.set(event.pointerId, now);
  });
  const release = (event) => {
    if (!down.delete(event.pointerId)) return;
    stage.classList.remove("dragging");
    if (event.type === "pointerup" && down.size === 0 && travelled_px <= CLICK_PX) onClick(at(event));
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);
  stage.addEventListener("pointerleave", () => onHover(null));
  stage.addEventListener("wheel", (event) => {
    if (!isMap(event)) return;
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? 1 : 32;
    zoomAt(...at(event), Math.exp(-0.0016 * lines * Math.max(-400, Math.min(400, event.deltaY))));
  }, { passive: false });
}

/** Two fingers: move with their middle, zoom with their distance. */
function pinch(down, movedId, now) {
  const [otherId] = [...down.keys()].filter((id) => id !== movedId);
  const [other, before] = [down.get(otherId), down.get(movedId)];
  const middle = [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2];
  panBy((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
  zoomAt(...middle, distance(now, other) / Math.max(distance(before, other), 1));
}
