// Shows what the program sends, and plays it once more when the program has ended. Binary messages
// are Meshcat's commands; text is for the page itself: a topic and its value.
const SHOW = {
  caption: showCaption,
  seed: showSeed,
  grippers: showGrippers,
  arms: (arms) => { setArms(arms); listArms(); },
  state: onState,
  clearance: addClearance,
  unmeasured: (reason) => { telemetry.unmeasured = reason; telemetry.version += 1; pointPanel(panelTime()); },
  waypoints: (waypoints) => { telemetry.waypoints = waypoints; listWaypoints(); },
  layers: (list) => { showLayers(list); document.body.classList.toggle("inked", list.some(({ id }) => id === "ink")); },
  clock: showClock,
  replay: becomeReplay,
};
const RETRY_MS = 1500;
const RETRY_GROWTH = 1.5; // each attempt is a line in the browser's console, which no page can prevent
const MAX_RETRY_MS = 10000; // below the 15 s that the demo waits for a page
const FIT_AFTER_MS = 150;
const CHECK_PERIOD_MS = 500;
const BODY_DEPTH_M = 0.1;
const HAND_MARGIN_M = 0.08;
const GOING_AWAY = 1001;
const url = `${location.protocol.replace("http", "ws")}//${location.host}/scene`;
const program = { isPaused: false, isRunning: false };

// A program started again on this port finds the page still open. A hidden page does not retry; it
// does so at once when it becomes visible.
let waitMs = RETRY_MS;
function retry() {
  if (document.hidden) return document.addEventListener("visibilitychange", retry, { once: true });
  const probe = new WebSocket(url);
  probe.onopen = () => location.reload();
  probe.onerror = () => setTimeout(retry, waitMs = Math.min(waitMs * RETRY_GROWTH, MAX_RETRY_MS));
}

function sendRequest(topic, value) {
  if (viewer.connection.readyState === WebSocket.OPEN) viewer.connection.send(JSON.stringify([topic, value]));
}

// The next press counts at once, before the program has answered this one.
function pauseProgram() {
  if (!program.isRunning) return;
  program.isPaused = !program.isPaused;
  sendRequest("pause", program.isPaused);
}

// A program that keeps its own time, as with a real robot, has no clock and cannot be paused.
function showClock(clock) {
  if (document.body.dataset.mode === "replay") return;
  document.body.classList.toggle("ready", clock !== null);
  if (clock) showTempo(clock);
}

function showTempo({ paused, speed, running }) {
  Object.assign(program, { isPaused: paused, isRunning: running });
  write(element("play"), paused ? "Resume" : "Pause");
  element("play").disabled = element("speed").disabled = !running;
  write(element("clock"), paused ? "paused" : running ? "live" : "ended");
  if (paused) announce("paused");
  const { options } = element("speed");
  if (![...options].some((option) => Number(option.value) === speed)) options.add(new Option(`${speed} ×`, speed));
  element("speed").value = String(speed);
}

// All states are stored as they arrive; the latest is drawn once a frame.
let latest = null;
function onState(state) {
  addState(state);
  if (!latest) requestAnimationFrame(() => { showState(latest); latest = null; });
  latest = state;
}

function showState(state) {
  if (document.body.dataset.mode !== "live") return;
  write(element("time"), `${state.time.toFixed(1)} s`);
  const moving = Object.keys(state.arms).find((side) => state.arms[side].v.some((v) => Math.abs(v) > 0.02));
  if (moving) view.side = moving;
  if (moving && moving !== panel.side && !panel.isChosen && telemetry.arms[moving]) chooseArm(moving);
  pointPanel(state.time);
  keepInView();
}

// Until the user turns the view, it is fitted to the bodies and both arms whenever a body comes.
let fitting;
function fitSoon(command) {
  if (command.type !== "set_object" || !/^\/(bodies|robot)\//.test(command.path)) return;
  clearTimeout(fitting);
  fitting = setTimeout(() => {
    if (document.body.dataset.mode !== "live") return;
    const bodies = viewer.scene_tree.children.bodies;
    const points = pointsNow(["right", "left"], []);
    view.points = [...points, ...(bodies ? Object.keys(bodies.children).flatMap((name) => upperPart(cornersOf(`/bodies/${name}`))) : [])];
    refit({ flies: true });
  }, FIT_AFTER_MS);
}

// The top of a table counts, not its leg.
function upperPart(corners) {
  const top = Math.max(...corners.map((corner) => corner[2]));
  return corners.map(([x, y, z]) => [x, y, Math.max(z, top - BODY_DEPTH_M)]);
}

// A hand that leaves the view makes it wider, unless the user has turned it.
let checked = 0;
function keepInView() {
  if (view.isTurned || view.name !== "fitted" || performance.now() < checked + CHECK_PERIOD_MS) return;
  checked = performance.now();
  const hand = handPoint();
  const seen = toThree(hand).project(viewer.camera);
  if (Math.max(Math.abs(seen.x), Math.abs(seen.y)) < 0.95) return;
  view.points.push(...around(hand, HAND_MARGIN_M));
  refit({ flies: true });
}

// The program has sent what it showed; from here on, the page does not need it.
let unpacking = Promise.resolve();
function becomeReplay(base64) {
  unpacking = decode(base64).then(playAgain).catch((error) => showStatus(`The replay cannot be shown: ${error.message}`));
}

function playAgain(content) {
  if (document.body.dataset.mode === "replay") return;
  element("loop").checked = false;
  element("play").disabled = element("speed").disabled = false;
  replay.speed = Number(element("speed").value);
  startReplay(content, { time: content.duration });
}

async function endShow({ code }) {
  await unpacking;
  const isReplay = document.body.dataset.mode === "replay";
  const ended = code === GOING_AWAY || isReplay;
  showStatus(ended
    ? `The program has ended${isReplay ? "; Again plays what it showed" : ""}. This page wakes up when it runs again.`
    : "The program has ended unexpectedly, or cannot be reached. This is what it showed last; this page wakes up when it runs again.");
  element("play").disabled = element("speed").disabled = !isReplay;
  if (!isReplay) write(element("clock"), "ended");
  setTimeout(retry, RETRY_MS);
}

startWith(() => {
  startPage();
  view.points = around([0.5, 0, 0.1], 0.6);
  refit();
  const handle = viewer.handle_command;
  viewer.handle_command = (command) => {
    handle(command);
    if (command.type === "set_object") applyLayersTo(command.path);
    fitSoon(command);
  };
  viewer.connect(url);
  const drawCommand = viewer.connection.onmessage;
  viewer.connection.onmessage = (message) => {
    if (typeof message.data !== "string") return drawCommand(message);
    const [topic, value] = JSON.parse(message.data);
    return SHOW[topic] && SHOW[topic](value);
  };
  viewer.connection.onopen = () => showStatus("");
  viewer.connection.onclose = endShow;
});
