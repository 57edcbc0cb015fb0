// Canvas layers and the strokes they share.

const theme = {};
const THEME_NAMES = [
  "paper", "surface", "ink", "muted", "line", "accent", "map", "map-area", "grid", "outline", "uncovered",
  "no-fly", "reserve", "truth", "fail", ...[0, 1, 2, 3, 4, 5].map((i) => `fleet-${i}`),
  ...CONDITIONS.map(([name]) => `user-${name}`),
];

/** Reads the style sheet's palette; again whenever light and dark change. */
function readTheme() {
  const style = getComputedStyle(document.documentElement);
  for (const name of THEME_NAMES) theme[name] = style.getPropertyValue(`--${name}`).trim();
  theme.font = style.getPropertyValue("--sans");
}

function fleetColour(fleet) {
  return fleet === null ? theme.reserve : theme[`fleet-${fleet % 6}`];
}

function userColour(condition) {
  return theme[`user-${condition}`] ?? theme.muted;
}

/** A canvas over the whole stage; later ones lie above. */
function addLayer(className = "") {
  const canvas = element("canvas", { className });
  const before = stage.querySelector(".map-buttons");
  stage.insertBefore(canvas, before);
  return { canvas, pen: canvas.getContext("2d"), key: null };
}

/** Whether a layer has to be drawn anew; if so it is sized and emptied. */
function isStale(layer, key) {
  if (layer.key === key) return false;
  layer.key = key;
  layer.pen = clearCanvas(layer.canvas, view.width_px, view.height_px);
  return true;
}

/** Sizes a canvas for the screen's pixels, empties it and leaves its units CSS pixels. */
function clearCanvas(canvas, width_px, height_px) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [Math.round(width_px * ratio), Math.round(height_px * ratio)];
  const pen = canvas.getContext("2d");
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  return pen;
}

function tracePath(pen, points_m) {
  points_m.forEach(([e_m, n_m], i) => {
    const [x_px, y_px] = toScreen(e_m, n_m);
    if (i === 0) pen.moveTo(x_px, y_px);
    else pen.lineTo(x_px, y_px);
  });
}

function tracePolygon(pen, points_m) {
  tracePath(pen, points_m);
  pen.closePath();
}

function traceDisk(pen, [e_m, n_m], radius_m) {
  const [x_px, y_px] = toScreen(e_m, n_m);
  const radius_px = radius_m * view.px_per_m;
  pen.moveTo(x_px + radius_px, y_px);
  pen.arc(x_px, y_px, radius_px, 0, 2 * Math.PI);
}

/** Diagonal stripes of one colour. */
function hatch(pen, colour) {
  const ratio = window.devicePixelRatio || 1;
  const size = Math.round(8 * ratio);
  const tile = element("canvas", { width: size, height: size });
  const tilePen = tile.getContext("2d");
  tilePen.strokeStyle = colour;
  tilePen.lineWidth = 1.5 * ratio;
  tilePen.beginPath();
  for (const shift of [-size, 0, size]) {
    tilePen.moveTo(shift, size);
    tilePen.lineTo(shift + size, 0);
  }
  tilePen.stroke();
  const pattern = pen.createPattern(tile, "repeat");
  pattern.setTransform(new DOMMatrix().scale(1 / ratio));
  return pattern;
}

/** Text on a rounded plate, centred at a pixel. */
function drawLabel(pen, text, x_px, y_px, colour) {
  pen.font = `600 11.5px ${theme.font}`;
  const width_px = pen.measureText(text).width + 10;
  pen.globalAlpha = 0.92;
  pen.fillStyle = theme.surface;
  pen.beginPath();
  pen.roundRect(x_px - width_px / 2, y_px - 9, width_px, 18, 5);
  pen.fill();
  pen.globalAlpha = 1;
  pen.fillStyle = colour;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(text, x_px, y_px + 0.5);
}

/** A user's symbol painted once, to be stamped thousands of times: far cheaper than as many paths. */
function symbolStamp(condition, r_px) {
  const size_px = Math.ceil(3.2 * r_px) + 2;
  const canvas = element("canvas");
  const pen = clearCanvas(canvas, size_px, size_px);
  pen.beginPath();
  traceSymbol(pen, condition, size_px / 2, size_px / 2, condition === "pending" ? 0.75 * r_px : r_px);
  paintSymbols(pen, condition, r_px);
  return { canvas, size_px };
}

/** Stamps a symbol centred at a pixel, on whole pixels of the screen so that its edges stay as painted. */
function stampAt(pen, { canvas, size_px }, [x_px, y_px]) {
  const ratio = window.devicePixelRatio || 1;
  const snap = (at_px) => Math.round((at_px - size_px / 2) * ratio) / ratio;
  pen.drawImage(canvas, snap(x_px), snap(y_px), canvas.width / ratio, canvas.height / ratio);
}

/** A user's symbol as part of the current path; the shape tells the condition without its colour. */
function traceSymbol(pen, condition, x_px, y_px, r_px) {
  if (condition === "ambiguous") {
    pen.moveTo(x_px, y_px - 1.25 * r_px);
    pen.lineTo(x_px + 1.15 * r_px, y_px + 0.85 * r_px);
    pen.lineTo(x_px - 1.15 * r_px, y_px + 0.85 * r_px);
    pen.closePath();
  } else if (condition === "poor_geometry") {
    pen.moveTo(x_px, y_px - 1.3 * r_px);
    pen.lineTo(x_px + 1.3 * r_px, y_px);
    pen.lineTo(x_px, y_px + 1.3 * r_px);
    pen.lineTo(x_px - 1.3 * r_px, y_px);
    pen.closePath();
  } else if (condition === "inconsistent") {
    pen.rect(x_px - r_px, y_px - r_px, 2 * r_px, 2 * r_px);
  } else if (condition === "not_located") {
    pen.moveTo(x_px - r_px, y_px - r_px);
    pen.lineTo(x_px + r_px, y_px + r_px);
    pen.moveTo(x_px + r_px, y_px - r_px);
    pen.lineTo(x_px - r_px, y_px + r_px);
  } else {
    pen.moveTo(x_px + r_px, y_px);
    pen.arc(x_px, y_px, r_px, 0, 2 * Math.PI);
  }
}

/** Paints the current path of symbols: strokes for what is unknown, filled otherwise. */
function paintSymbols(pen, condition, r_px) {
  const colour = userColour(condition);
  if (condition === "pending" || condition === "not_located") {
    pen.strokeStyle = colour;
    pen.lineWidth = Math.max(1.1, r_px * 0.4);
    pen.stroke();
  } else {
    pen.fillStyle = colour;
    pen.fill();
  }
}
