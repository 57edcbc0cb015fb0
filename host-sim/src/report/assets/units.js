// Formatting: no number is shown without its unit, no missing number as anything but a dash.

const DASH = "–";
/** Between a number and its unit. */
const GAP = "\u202f";

function isNumber(x) {
  return typeof x === "number" && Number.isFinite(x);
}

function formatNumber(x, decimals = 0) {
  if (!isNumber(x)) return DASH;
  const rounded = Math.abs(x) < 0.5 * 10 ** -decimals ? 0 : x; // no "-0"
  const digits = { minimumFractionDigits: decimals, maximumFractionDigits: decimals };
  return rounded.toLocaleString("en-GB", digits).replace("-", "−");
}

function formatWith(x, unit, decimals = 0) {
  return isNumber(x) ? formatNumber(x, decimals) + GAP + unit : DASH;
}

/** Metres below a kilometre, kilometres above. */
function formatLength(x_m) {
  if (!isNumber(x_m)) return DASH;
  if (Math.abs(x_m) >= 1000) return formatWith(x_m / 1000, "km", 2);
  return formatWith(x_m, "m", Math.abs(x_m) < 100 ? 1 : 0);
}

/** A round length for a scale or a grid. */
function formatStep(x_m) {
  if (x_m >= 1000) return `${x_m / 1000}${GAP}km`;
  return x_m >= 1 ? `${x_m}${GAP}m` : `${Math.round(x_m * 100)}${GAP}cm`;
}

function formatArea(x_m2) {
  if (!isNumber(x_m2)) return DASH;
  return x_m2 >= 1e5 ? formatWith(x_m2 / 1e6, "km²", 2) : formatWith(x_m2, "m²");
}

/** Rounded down where it would otherwise claim a whole that is not there. */
function formatShare(fraction, decimals = 1) {
  if (!isNumber(fraction)) return DASH;
  const step = 10 ** (decimals + 2);
  const shown = fraction < 1 ? Math.min(fraction, (step - 1) / step) : fraction;
  return formatWith(shown * 100, "%", decimals);
}

function formatBytes(bytes) {
  if (!isNumber(bytes)) return DASH;
  if (bytes < 1e4) return formatWith(bytes, "B");
  return bytes < 1e6 ? formatWith(bytes / 1e3, "kB", 1) : formatWith(bytes / 1e6, "MB", 1);
}

/** Time since the start of the mission, h:mm:ss. */
function formatClock(t_s) {
  if (!isNumber(t_s)) return DASH;
  const whole = Math.max(0, Math.floor(t_s + 1e-6));
  const two = (x) => String(x).padStart(2, "0");
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

/** An element with properties and children. Text always goes in as text, never as markup. */
function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

function byId(id) {
  return document.getElementById(id);
}
