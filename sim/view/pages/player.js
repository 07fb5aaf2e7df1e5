// Plays the recording embedded in this page. Time is kept here, not by Meshcat's animator, whose
// slider does nothing before it has played once and which forgets its place at the end.
const PAUSE_BEFORE_LOOP_S = 1.5;
const STEP_S = 0.1;
const LONGEST_FRAME_S = 0.5; // a tab that slept goes on where it was
const MOST_LABELS = 10;
const INDICES_PER_STRETCH = 24;

const replay = { ready: false, time: 0, duration: 0, playing: false, speed: 1 };
let viewer;
let recording;
let lines = [];

// The recording is msgpack; Meshcat's decoder is reached by letting its viewer decode a command and
// keep the result instead of drawing it.
function decode(base64) {
  let decoded;
  const reader = Object.create(MeshCat.Viewer.prototype);
  reader.handle_command = (value) => { decoded = value; };
  reader.handle_command_bytearray(Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)));
  return decoded;
}

// Geometries drawn more than once are stored once, by name.
function draw(commands, geometries) {
  for (const command of commands) {
    if (command.type === "set_object") {
      command.object.geometries = command.object.geometries.map((g) => geometries[g.uuid] || g);
    }
    viewer.handle_command(command);
  }
}

// The part of a line that is behind the tip, and the one ahead of it.
function line({ path, times }) {
  const part = (name) => viewer.scene_tree.find([...path.split("/").filter(Boolean), name, "<object>"]).object.geometry;
  return { times, behind: part("behind"), ahead: part("ahead") };
}

function showLine({ times, behind, ahead }) {
  const passed = INDICES_PER_STRETCH * Math.max(0, countUntil(times, replay.time) - 1);
  behind.setDrawRange(0, passed);
  ahead.setDrawRange(passed, Infinity);
}

// How many of the ascending times have come.
function countUntil(times, time) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-9) low = middle + 1;
    else high = middle;
  }
  return low;
}

// The last of [time, ...values] that has come.
const current = (entries, time) => entries[Math.max(0, countUntil(entries.map((e) => e[0]), time) - 1)];

replay.seek = (time) => {
  replay.time = Math.min(Math.max(time, 0), replay.duration);
  viewer.animator.seek(replay.time);
  lines.forEach(showLine);
  showTime();
};
replay.play = () => {
  if (replay.time >= replay.duration) replay.seek(0);
  replay.playing = true;
  showTime();
};
replay.pause = () => {
  replay.playing = false;
  showTime();
};
replay.toggle = () => (replay.playing ? replay.pause() : replay.play());
replay.jump = (time) => {
  replay.pause();
  replay.seek(time);
};

function showTime() {
  element("scrub").value = replay.time;
  element("scrub").style.setProperty("--done", `${100 * replay.time / (replay.duration || 1)}%`);
  write(element("time"), `${replay.time.toFixed(1)} / ${replay.duration.toFixed(1)} s`);
  write(element("play"), replay.playing ? "Pause" : "Play");
  showCaption(recording.captions.length ? current(recording.captions, replay.time)[1] : "");
  showSeed(current(recording.seeds, replay.time)[1]);
  const grippers = Object.entries(recording.grippers);
  showGrippers(Object.fromEntries(grippers.map(([side, phases]) => [side, current(phases, replay.time).slice(1)])));
}

// Thin ticks where a stage begins, and buttons where something is grasped, released or missed.
function showMarks() {
  const place = (node, time) => {
    node.style.left = `${100 * time / (recording.duration || 1)}%`;
    element("marks").append(node);
  };
  for (const [time, text] of recording.captions.slice(1)) {
    place(Object.assign(document.createElement("i"), { title: text }), time);
  }
  for (const [time, kind, text] of recording.marks) {
    const button = Object.assign(document.createElement("button"), { type: "button", className: kind, title: text, textContent: kind });
    button.addEventListener("click", () => replay.jump(time));
    place(button, time);
  }
  element("marks").classList.toggle("dense", recording.marks.length > MOST_LABELS);
}

// The robot's meshes, the body that plans are made with, or both; only pages with a body ask.
function showLayer() {
  const chosen = element("layer").value;
  for (const [layer, paths] of Object.entries(recording.layers)) {
    const value = chosen === layer || chosen === "both";
    for (const path of paths) viewer.handle_command({ type: "set_property", path, property: "visible", value });
  }
  viewer.set_dirty();
}

let overtime = 0;
function advance(elapsed) {
  const next = replay.time + elapsed * replay.speed;
  overtime = next < replay.duration ? 0 : overtime + elapsed;
  if (overtime > PAUSE_BEFORE_LOOP_S) replay.seek(0);
  else if (replay.time < replay.duration) replay.seek(next);
  if (overtime > 0 && !element("loop").checked) replay.pause();
}

let last;
function tick(now) {
  const elapsed = Math.min((now - last) / 1000, LONGEST_FRAME_S);
  last = now;
  if (replay.playing) advance(elapsed);
  requestAnimationFrame(tick);
}

const KEYS = {
  " ": () => replay.toggle(),
  ArrowLeft: () => replay.jump(replay.time - STEP_S),
  ArrowRight: () => replay.jump(replay.time + STEP_S),
  Home: () => replay.jump(0),
  End: () => replay.jump(replay.duration),
};

function listen() {
  element("play").addEventListener("click", replay.toggle);
  element("scrub").addEventListener("input", (event) => replay.jump(Number(event.target.value)));
  element("layer").addEventListener("change", showLayer);
  element("speed").addEventListener("change", (event) => { replay.speed = Number(event.target.value); });
  document.addEventListener("keydown", (event) => {
    const act = KEYS[event.key];
    if (!act || event.target.tagName === "SELECT" || event.ctrlKey || event.metaKey || event.altKey) return;
    act();
    event.preventDefault();
  });
}

startWith(() => {
  recording = decode(element("data").textContent);
  viewer = createViewer(recording.sides);
  draw(recording.commands, recording.geometries);
  viewer.animator.play(); // binds the tracks to the nodes; without it they cannot be moved
  viewer.animator.pause();
  lines = recording.paths.map(line);
  replay.duration = recording.duration;
  element("scrub").max = replay.duration;
  element("layered").hidden = Object.keys(recording.layers).length === 0;
  showLayer();
  showMarks();
  listen();
  replay.seek(0);
  viewer.render();
  replay.play();
  document.body.classList.add("ready");
  replay.ready = true;
  last = performance.now();
  requestAnimationFrame(tick);
});
