// Data over time: joints against their limits, the clearance, the waypoints. A replay has all of it; a
// live page collects the last seconds. Values of n times are flat, n * joints.
const LIVE_WINDOW_S = 20;
const MAX_SAMPLES = 4000;
const SAME_PAIR_WITHIN_S = 0.5;

const telemetry = { arms: {}, bounds: [], clearance: null, unmeasured: "", waypoints: [], from: 0, to: 1, version: 0 };

// What the plots show of a replay or a live page: all of a short one, else the last seconds before the
// time shown, and a little of what follows, so that the cursor is never at the edge.
const PLOT_WINDOW_S = 10;
const AHEAD_S = 2;
let heldWindow = null; // while a plot is pressed, so that it does not move under the pointer
function plotWindow(time) {
  if (heldWindow) return heldWindow;
  const { from, to } = telemetry;
  if (to - from <= PLOT_WINDOW_S) return { from, to };
  const end = Math.min(Math.max(time + AHEAD_S, from + PLOT_WINDOW_S), to);
  return { from: end - PLOT_WINDOW_S, to: end };
}

function loadRecorded(content) {
  Object.assign(telemetry, {
    arms: content.arms || {},
    bounds: content.bounds || [],
    clearance: content.clearance || null,
    unmeasured: content.unmeasured || "",
    waypoints: content.waypoints || [],
    from: 0,
    to: content.duration || 1,
    version: telemetry.version + 1,
  });
}

// Live: the arms there are, each with the limits of its joints; samples follow.
function setArms(arms) {
  telemetry.arms = {};
  for (const [side, arm] of Object.entries(arms)) telemetry.arms[side] = { ...arm, times: [], q: [], v: [], a: [] };
}

function addState({ time, arms }) {
  if (time < telemetry.to - 1e-6) clearSamples();
  for (const [side, { q, v, a }] of Object.entries(arms)) {
    const arm = telemetry.arms[side];
    if (!arm || arm.times[arm.times.length - 1] === time) continue;
    arm.times.push(time);
    arm.q.push(...q);
    arm.v.push(...v);
    arm.a.push(...a);
    shorten(arm, { times: 1, q: q.length, v: q.length, a: q.length }, time);
  }
  telemetry.to = time;
  telemetry.from = Math.max(0, time - LIVE_WINDOW_S);
  telemetry.version += 1;
}

function addClearance(value) {
  if (!value) {
    telemetry.clearance = null;
    return;
  }
  const known = telemetry.clearance || { times: [], distance_m: [], names: [], pairs: [], points: [] };
  telemetry.clearance = known;
  const index = (name) => (known.names.includes(name) ? known.names.indexOf(name) : known.names.push(name) - 1);
  known.times.push(value.time);
  known.distance_m.push(value.distance_m);
  known.pairs.push(index(value.first), index(value.second));
  known.points.push(...value.points);
  shorten(known, { times: 1, distance_m: 1, pairs: 2, points: 6 }, value.time);
}

// Time that begins again belongs to another run.
function clearSamples() {
  setArms(telemetry.arms);
  telemetry.clearance = null;
}

// Drop what has left the window, now and then rather than with each sample.
function shorten(arrays, widths, time) {
  const gone = countUntil(arrays.times, time - LIVE_WINDOW_S) - 1;
  const dropped = Math.max(arrays.times.length - MAX_SAMPLES, gone > 300 ? gone : 0);
  if (dropped > 0) for (const [key, width] of Object.entries(widths)) arrays[key].splice(0, dropped * width);
}

// Between two samples: the index of the earlier, and the share of the way to the later.
function bracket(times, time) {
  const i = Math.max(0, Math.min(countUntil(times, time) - 1, times.length - 1));
  const span = times[i + 1] - times[i];
  return [i, span > 0 ? Math.min(Math.max((time - times[i]) / span, 0), 1) : 0];
}

// The values of "q", "v" or "a" at a time.
function jointValues(arm, key, time) {
  if (!arm.times.length) return null;
  const [i, share] = bracket(arm.times, time);
  const value = (row, joint) => arm[key][row * arm.joints.length + joint];
  return Array.from(arm.joints, (_, j) => (share ? (1 - share) * value(i, j) + share * value(i + 1, j) : value(i, j)));
}

// A value as a share of its limit: 1 and -1 are the limits, 0 the middle between them.
const SHARE = {
  q: (arm, j, value) => (2 * value - arm.q_max[j] - arm.q_min[j]) / (arm.q_max[j] - arm.q_min[j]),
  v: (arm, j, value) => value / arm.v_max[j],
  a: (arm, j, value) => value / arm.a_max[j],
};

// The nearest pair at a time: { distance, first, second, points }, or null where it is not known.
function clearanceAt(time) {
  const known = telemetry.clearance;
  if (!known || !known.times.length) return null;
  const [i, share] = bracket(known.times, time);
  const name = (k) => known.names[known.pairs[k]];
  const later = i + 1;
  const goesOn = share > 0 && known.times[later] - known.times[i] < SAME_PAIR_WITHIN_S
    && known.pairs[2 * i] === known.pairs[2 * later] && known.pairs[2 * i + 1] === known.pairs[2 * later + 1];
  const between = (values, k, width) => values[i * width + k] + (goesOn ? share * (values[later * width + k] - values[i * width + k]) : 0);
  return {
    distance: between(known.distance_m, 0, 1),
    first: name(2 * i),
    second: name(2 * i + 1),
    points: [0, 1, 2, 3, 4, 5].map((k) => between(known.points, k, 6)),
  };
}

// Numbers of the waypoints that are being moved to: one, or one of each arm.
const waypointsAt = (time) => [...telemetry.waypoints.keys()].filter((k) => {
  const { start, end } = telemetry.waypoints[k];
  return start < time && (end === null || time <= end + 1e-6);
});

// A residual with one digit, such as 3e−12 m, on one line.
const residual = (value, unit) => `${value === 0 ? 0 : value.toExponential(0).replace("-", "−")}\u00a0${unit}`;

const signed = (value, digits) => value.toFixed(digits).replace(/^-(?=0\.?0*$)/, "").replace("-", "−");
