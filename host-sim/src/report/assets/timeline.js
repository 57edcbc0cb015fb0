// Time: the slider, playing, phases, and the marks of the events.

const SPEEDS = [1, 2, 5, 10, 30, 60, 120, 300, 600];
const SPEED_AT_START = 120;
/** A phase whose name does not fit goes without it below this width, and is cut short above. */
const NAMED_PHASE_PX = 80;

const clock = { t_s: data.end_s, playing: false, speed: SPEED_AT_START, frame_ms: null };
const slider = byId("time");

function setTime(t_s) {
  clock.t_s = Math.min(Math.max(Number(t_s) || 0, 0), data.end_s);
  requestDraw();
}

function setPlaying(playing) {
  if (playing && clock.t_s >= data.end_s) clock.t_s = 0;
  clock.playing = playing;
  clock.frame_ms = null;
  requestDraw();
}

/** Moves the clock on while the mission plays. */
function tick(now_ms) {
  if (!clock.playing) return;
  const passed_s = clock.frame_ms === null ? 0 : Math.min((now_ms - clock.frame_ms) / 1000, 0.25);
  clock.frame_ms = now_ms;
  clock.t_s = Math.min(clock.t_s + passed_s * clock.speed, data.end_s);
  if (clock.t_s >= data.end_s) clock.playing = false;
  requestDraw();
}

function buildTimeline() {
  slider.max = String(Math.ceil(data.end_s));
  slider.addEventListener("input", () => setTime(slider.valueAsNumber));
  byId("clock-end").textContent = `of ${formatClock(data.end_s)} h`;
  for (const speed of SPEEDS) byId("speed").append(element("option", { value: String(speed) }, `${speed}×`));
  byId("speed").value = String(clock.speed);
  byId("speed").addEventListener("change", (event) => { clock.speed = Number(event.target.value); });
  byId("play").addEventListener("click", () => setPlaying(!clock.playing));
  data.phases.forEach((phase, i) => byId("phases").append(phaseButton(phase, i)));
  document.addEventListener("keydown", onKey);
}

function phaseEnd(i) {
  return Math.min(data.phases[i + 1]?.t_s ?? data.end_s, data.end_s);
}

function phaseButton(phase, i) {
  const length_s = Math.max(phaseEnd(i) - phase.t_s, 0);
  const title = `${phase.name}: from ${formatClock(phase.t_s)} for ${formatClock(length_s)} h`;
  const button = element("button", { type: "button", title }, phase.name);
  button.style.left = `${(100 * phase.t_s) / data.end_s}%`;
  button.style.width = `${(100 * length_s) / data.end_s}%`;
  button.addEventListener("click", () => setTime(phase.t_s));
  return button;
}

function onKey(event) {
  const typing = event.target.closest?.("select, input[type=text]");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const step_s = event.shiftKey ? 60 : 10;
  const actions = {
    ArrowLeft: () => setTime(clock.t_s - step_s),
    ArrowRight: () => setTime(clock.t_s + step_s),
    "+": () => zoomCentre(ZOOM_STEP),
    "-": () => zoomCentre(1 / ZOOM_STEP),
    0: fit,
  };
  // On a button or a switch, space means that button.
  if (!event.target.closest?.("button, summary, input[type=checkbox]")) actions[" "] = () => setPlaying(!clock.playing);
  const action = actions[event.key];
  if (!action) return;
  event.preventDefault();
  action();
}

function layOutPhases() {
  [...byId("phases").children].forEach((button, i) => {
    button.classList.remove("thin");
    button.textContent = data.phases[i].name;
    const isCut = button.scrollWidth > button.clientWidth;
    const goesUnnamed = isCut && button.clientWidth < NAMED_PHASE_PX;
    button.classList.toggle("thin", goesUnnamed);
    if (goesUnnamed) button.textContent = "";
  });
}

function drawTicks() {
  const canvas = byId("ticks");
  const pen = clearCanvas(canvas, canvas.clientWidth, canvas.clientHeight);
  pen.fillStyle = theme.muted;
  pen.globalAlpha = 0.7;
  for (const { t_s } of data.events) pen.fillRect((t_s / data.end_s) * (canvas.clientWidth - 1), 1, 1.2, 5);
}

function updateTimeline() {
  slider.value = String(Math.round(clock.t_s));
  slider.style.setProperty("--part", `${(100 * clock.t_s) / data.end_s}%`);
  slider.setAttribute("aria-valuetext", formatClock(clock.t_s));
  byId("clock").textContent = formatClock(clock.t_s);
  byId("play").classList.toggle("playing", clock.playing);
  byId("play").setAttribute("aria-label", clock.playing ? "Pause" : "Play");
  const now = phaseIndexAt(clock.t_s);
  byId("phase-now").textContent = data.phases[now]?.name ?? "";
  [...byId("phases").children].forEach((button, i) => button.classList.toggle("now", i === now));
}
