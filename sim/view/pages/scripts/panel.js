// The side panel: joints, bounds, clearance and waypoints, at the time of the scrubber.
const QUANTITIES = { q: ["Angle", "rad", 2], v: ["Velocity", "rad/s", 2], a: ["Acceleration", "rad/s²", 2] };
// What moves keep within a bound: label, unit, digits, and the size of the unit.
const BOUNDS = {
  distance: ["Distance from the path", "\u00a0mm", 2, 1e-3],
  turn: ["Turn from the path", "°", 2, Math.PI / 180],
  tilt: ["Tilt of what is held", "°", 1, Math.PI / 180],
};
const UNMEASURED = {
  motion: "Not measured: no arm has moved.",
  body: "Not measured: the robot lacks links of the body that clearances are measured with.",
  pair: "Not measured: nothing is there that counts.",
};
const REFRESH_MS = 100;
const WIDE_PX = 1100;
const HIGH_PX = 640;
const BOTH = "both";
const LANE_OFFSET = 1.15; // of both arms' curves in one plot: the left arm's above, the right arm's below

const panel = { plots: {}, bounds: [], clearance: null, side: null, isChosen: false, joint: null, cells: [], drawn: -1, from: 0, refreshed: 0, waiting: 0, time: 0, waypoints: null };

// Where the panel is: the replay's time, or now.
const panelTime = () => panel.time;

function createPanel() {
  for (const key of Object.keys(QUANTITIES)) panel.plots[key] = createPlot(element(`plot-${key}`), seekFromPanel);
  panel.clearance = createPlot(element("plot-clearance"), seekFromPanel);
  element("arm").addEventListener("change", () => { panel.isChosen = true; chooseArm(element("arm").value); });
  element("acceleration").addEventListener("change", showAcceleration);
  showAcceleration();
  element("panel-button").addEventListener("click", () => openPanel(element("panel").hidden));
  element("stages").addEventListener("change", (event) => seekFromPanel(Number(event.target.value)));
  for (const details of element("panel").querySelectorAll("details")) details.addEventListener("toggle", drawPanel);
  new ResizeObserver(drawPanel).observe(element("panel"));
  prefersDark.addEventListener("change", () => { paintStage(viewer); paintNearest(viewer); drawPanel(); });
  openPanel(window.innerWidth >= WIDE_PX && window.innerHeight >= HIGH_PX);
}

function openPanel(isOpen) {
  element("panel").hidden = !isOpen;
  element("panel-button").setAttribute("aria-expanded", isOpen);
  drawPanel();
  refit({ flies: true });
}

// Accelerations change too often to be read at a glance: their plot and column come on demand.
function showAcceleration() {
  const isShown = element("acceleration").checked;
  element("plot-a").hidden = !isShown;
  element("joint-table").classList.toggle("no-acceleration", !isShown);
  drawPanel();
}

function seekFromPanel(time) {
  if (document.body.dataset.mode === "replay") replay.jump(time);
}

// New data: other arms, or other limits. A replay shows all arms that moved.
function listArms() {
  const sides = Object.keys(telemetry.arms);
  const choices = sides.length > 1 ? [...sides, BOTH] : sides;
  element("arm").replaceChildren(...choices.map((side) => make("option", { value: side, textContent: side === BOTH ? "both arms" : `${side} arm` })));
  element("joint-section").hidden = sides.length === 0;
  const wanted = document.body.dataset.mode === "replay" && !panel.isChosen ? choices[choices.length - 1] : panel.side;
  if (sides.length) chooseArm(choices.includes(wanted) ? wanted : sides[0]);
}

// The arms whose joints are shown: the chosen one, or both.
const shownArms = () => (panel.side === BOTH ? Object.keys(telemetry.arms) : [panel.side]).filter((side) => telemetry.arms[side]);

// Their joints in order; each of them knows where the zero of its curves is in a plot.
function shownJoints() {
  const sides = shownArms();
  return sides.flatMap((side, k) => telemetry.arms[side].joints.map((name, j) => {
    const zero = sides.length > 1 ? [LANE_OFFSET, -LANE_OFFSET][k] : 0;
    return { arm: telemetry.arms[side], name, j, zero };
  }));
}

function chooseArm(side) {
  panel.side = side;
  panel.joint = null;
  element("arm").value = side;
  listJoints();
  drawPanel();
}

// One row a joint; its head is also the key to its curve, and brings it out.
function listJoints() {
  panel.cells = [];
  const isBoth = shownArms().length > 1;
  element("joint-section").classList.toggle("both", isBoth);
  element("joints").replaceChildren(...shownJoints().map(({ name, j }, row) => {
    const [side, joint] = name.split("_");
    const button = make("button", { type: "button", title: `bring out ${name}` }, swatch(j), isBoth ? `${side[0].toUpperCase()} ${joint}` : joint);
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => bringOut(row));
    const cells = Object.keys(QUANTITIES).map(() => make("td"));
    panel.cells.push(cells);
    const head = make("th", {}, button);
    head.scope = "row";
    return make("tr", {}, head, ...cells);
  }));
}

function swatch(j) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 30 8");
  svg.setAttribute("aria-hidden", "true");
  const stroke = document.createElementNS("http://www.w3.org/2000/svg", "path");
  stroke.setAttribute("d", "M0 4H30");
  stroke.setAttribute("style", `stroke: var(--joint-${j}); stroke-dasharray: ${DASHES[j].join(" ") || "none"}`);
  svg.append(stroke);
  return svg;
}

function bringOut(j) {
  panel.joint = panel.joint === j ? null : j;
  element("joints").querySelectorAll("button").forEach((button, k) => button.setAttribute("aria-pressed", k === panel.joint));
  drawPanel();
}

// A plot for each kind of bound; the words above it follow the time.
function listBounds() {
  element("bound-section").hidden = !telemetry.bounds.length;
  panel.bounds = telemetry.bounds.map(({ kind, spans }) => {
    const canvas = make("canvas", {});
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${BOUNDS[kind][0]} over time; the line above has the number`);
    const words = make("figcaption", {});
    const figure = make("figure", {}, words, make("div", { className: "plot" }, canvas, make("i", {})));
    return { kind, spans, words, figure, plot: createPlot(figure, seekFromPanel) };
  });
  element("bounds").replaceChildren(...panel.bounds.map(({ figure }) => figure));
}

function boundPicture({ kind, spans }) {
  const { from, to } = plotWindow(panel.time);
  const [, , , unit] = BOUNDS[kind];
  const shown = spans.filter(({ times }) => times[0] <= to && times[times.length - 1] >= from);
  const high = Math.max(...spans.map(({ limit }) => limit), ...spans.flatMap(({ values }) => Array.from(values))) / unit;
  const curves = shown.flatMap(({ times, values, limit }) => [
    { times: [times[0], times[times.length - 1]], values: () => limit / unit, colour: "--limit", dash: [6, 4], width: 1.2 },
    { times, values: (i) => values[i] / unit, colour: "--bound", dash: [], width: 2 },
  ]);
  return { from, to, low: 0, high: 1.08 * high, curves, rules: [0, high / 2, high].map((at) => ({ at, label: short(at) })) };
}

const short = (value) => String(Number(value.toPrecision(2)));

function showBounds(time) {
  for (const { kind, spans, words } of panel.bounds) {
    const [label, name, digits, unit] = BOUNDS[kind];
    const span = spans.find(({ times }) => times[0] <= time && time <= times[times.length - 1] + 1e-6);
    if (!span) { write(words, `${label}, ${name.trim()}`); continue; }
    const [i, share] = bracket(span.times, time);
    const value = span.values[i] + (share ? share * (span.values[i + 1] - span.values[i]) : 0);
    write(words, `${label}: ${(value / unit).toFixed(digits)} of ${short(span.limit / unit)}${name}`);
  }
}

// Draw the curves; the cursor and the numbers follow in pointPanel.
function drawPanel() {
  if (element("panel").hidden || !viewer) return;
  panel.drawn = telemetry.version;
  panel.from = plotWindow(panel.time).from;
  if (shownArms().length) for (const key of Object.keys(QUANTITIES)) panel.plots[key].draw(jointPicture(key));
  for (const bound of panel.bounds) bound.plot.draw(boundPicture(bound));
  element("clearance-section").hidden = !telemetry.clearance && !telemetry.unmeasured;
  element("plot-clearance").hidden = !telemetry.clearance;
  if (telemetry.clearance) panel.clearance.draw(clearancePicture(telemetry.clearance));
  pointPanel(panel.time, { isNow: true });
}

function jointPicture(key) {
  const joints = shownJoints();
  const only = joints[panel.joint];
  const curves = joints.map((joint) => {
    const { arm, j, zero } = joint;
    return {
      times: arm.times,
      values: (i) => zero + SHARE[key](arm, j, arm[key][i * arm.joints.length + j]),
      colour: !only || only === joint ? `--joint-${j}` : "--grid",
      dash: DASHES[j],
      width: only === joint ? 2.4 : 1.5,
    };
  });
  if (only) curves.push(...curves.splice(panel.joint, 1)); // above all others
  const sides = shownArms();
  const rules = sides.length > 1 ? laneRules(sides) : jointRules(only, key);
  const high = sides.length > 1 ? LANE_OFFSET + 1.08 : 1.08;
  return { ...plotWindow(panel.time), low: -high, high, curves, rules };
}

// The zero and the limits of each arm.
function laneRules(sides) {
  return sides.flatMap((side, k) => {
    const zero = [LANE_OFFSET, -LANE_OFFSET][k];
    return [{ at: zero + 1, label: "", isLimit: true }, { at: zero, label: side }, { at: zero - 1, label: "", isLimit: true }];
  });
}

// The limits; in numbers where they are those of one joint.
function jointRules(only, key) {
  const middle = { at: 0, label: "0" };
  if (!only) return [{ at: 1, label: "100 %", isLimit: true }, middle, { at: -1, label: "−100 %", isLimit: true }];
  const { arm, j } = only;
  const [low, high] = key === "q" ? [arm.q_min[j], arm.q_max[j]] : [-arm[`${key}_max`][j], arm[`${key}_max`][j]];
  middle.label = signed((low + high) / 2, 2);
  return [{ at: 1, label: signed(high, 2), isLimit: true }, middle, { at: -1, label: signed(low, 2), isLimit: true }];
}

function clearancePicture({ times, distance_m: distances }) {
  const { from, to } = plotWindow(panel.time);
  const first = Math.max(0, countUntil(times, from) - 1);
  const most = Math.max(0.05, ...Array.from(distances).slice(first, countUntil(times, to) + 1));
  const high = Math.ceil(most / 0.05) * 0.05;
  const rules = [0, high / 2, high].map((at) => ({ at, label: `${Math.round(1000 * at)}` }));
  const curve = { times, values: (i) => distances[i], colour: "--nearest", dash: [], width: 2 };
  return { from, to, low: 0, high: 1.04 * high, curves: [curve], rules };
}

// Follow the time: cursors with each frame, words and numbers ten times a second.
function pointPanel(time, { isNow = false } = {}) {
  panel.time = time;
  showNearest(clearanceAt(time));
  if (element("panel").hidden) return;
  for (const plot of [...Object.values(panel.plots), ...panel.bounds.map(({ plot: one }) => one), panel.clearance]) plot.point(time);
  clearTimeout(panel.waiting);
  const wait = isNow ? 0 : panel.refreshed + REFRESH_MS - performance.now();
  if (wait > 0) panel.waiting = setTimeout(refreshPanel, wait);
  else refreshPanel();
}

function refreshPanel() {
  panel.refreshed = performance.now();
  if (panel.drawn !== telemetry.version || panel.from !== plotWindow(panel.time).from) return drawPanel();
  showNumbers(panel.time);
  showBounds(panel.time);
  showPair(clearanceAt(panel.time));
  showWaypoint(panel.time);
}

function showNumbers(time) {
  let row = 0;
  for (const arm of shownArms().map((side) => telemetry.arms[side])) {
    Object.entries(QUANTITIES).forEach(([key, [, , digits]], column) => {
      const values = jointValues(arm, key, time);
      if (values) values.forEach((value, j) => showValue(panel.cells[row + j][column], value, digits, SHARE[key](arm, j, value)));
    });
    row += arm.joints.length;
  }
}

function showValue(cell, value, digits, share) {
  if (!cell.firstChild) cell.append(make("span"), " ", make("small"));
  write(cell.firstChild, signed(value, digits));
  write(cell.lastChild, `${Math.round(100 * Math.abs(share))} %`);
}

function showPair(nearest) {
  write(element("pair"), nearest ? `${millimetres(nearest.distance)} between ${pairText(nearest)}` : UNMEASURED[telemetry.unmeasured] || "");
}
