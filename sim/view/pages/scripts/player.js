// Plays a recording: that of a replay's file, or what a live page has shown when its program ends.
// Time is kept here, not by Meshcat's animator, whose slider does nothing before it has played once
// and which loses its position at the end.
const PAUSE_BEFORE_LOOP_S = 1.5;
const STEP_S = 0.1;
const MAX_FRAME_S = 0.5; // a tab that slept goes on where it was
const INDICES_PER_SEGMENT = 24;
const FIT_SAMPLES = 16;

const replay = { ready: false, time: 0, duration: 0, playing: false, speed: 1 };
let recording;
let lines = [];

// The part of a line that is behind the tip, and the one ahead of it.
function line({ path, times }) {
  const part = (name) => drawnAt(nodeAt(`${path}/${name}`)).geometry;
  return { times, behind: part("behind"), ahead: part("ahead") };
}

// Ink is not there before it is drawn.
const inkLine = ({ path, times }) => ({ times, behind: drawnAt(nodeAt(path)).geometry });

function showLine({ times, behind, ahead }) {
  const passed = INDICES_PER_SEGMENT * Math.max(0, countUntil(times, replay.time) - 1);
  behind.setDrawRange(0, passed);
  if (ahead) ahead.setDrawRange(passed, Infinity);
}

// The last of [time, ...values] that has passed.
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
  clearTimeout(announcing);
  showTime();
};
replay.pause = () => {
  replay.playing = false;
  showTime();
  pointPanel(replay.time, { isNow: true });
  announceTime();
};
replay.toggle = () => (replay.playing ? replay.pause() : replay.play());
replay.jump = (time) => {
  replay.playing = false;
  replay.seek(time);
  pointPanel(replay.time, { isNow: true });
  announceTime();
};

const captionNow = () => (recording.captions.length ? current(recording.captions, replay.time)[1] : "");

function showTime() {
  element("scrub").value = replay.time;
  element("scrub").style.setProperty("--done", `${100 * replay.time / (replay.duration || 1)}%`);
  write(element("time"), `${replay.time.toFixed(1)} / ${replay.duration.toFixed(1)} s`);
  const isAtEnd = replay.time >= replay.duration && replay.duration > 0;
  write(element("play"), replay.playing ? "Pause" : isAtEnd ? "Again" : "Play");
  showCaption(captionNow());
  showSeed(current(recording.seeds, replay.time)[1]);
  const grippers = Object.entries(recording.grippers);
  showGrippers(Object.fromEntries(grippers.map(([side, phases]) => [side, current(phases, replay.time).slice(1)])));
  view.side = movingSide();
  pointPanel(replay.time);
  if (!element("stages").matches(":focus")) element("stages").selectedIndex = countUntil(recording.captions.map((c) => c[0]), replay.time) - 1;
}

// Whose hand the camera follows: the arm that moves, or the one that moved last.
function movingSide() {
  const begun = telemetry.waypoints.filter(({ start }) => start <= replay.time);
  const latest = begun.length ? begun[begun.length - 1].side : recording.sides[0];
  return latest || view.side;
}

// After a pause or a jump, not while it plays.
function announceTime() {
  const text = `${replay.time.toFixed(1)} of ${replay.duration.toFixed(1)} seconds, ${captionNow()}`;
  element("scrub").setAttribute("aria-valuetext", text);
  announce(text);
}

// Where the time line shows the moves of each arm by itself: both have moved.
const lanes = () => (recording.sides.length > 1 ? recording.sides : []);

// Of both arms, each one's moves above or below the slider; an arm that holds something has the
// gripper's colour then.
function showLanes() {
  element("track").classList.toggle("both", lanes().length > 0);
  const share = (time) => `${100 * time / (recording.duration || 1)}%`;
  for (const side of ["left", "right"]) {
    const moves = lanes().length ? telemetry.waypoints.filter((waypoint) => waypoint.side === side) : [];
    element(`${side}-lane`).setAttribute("aria-label", `${side} arm: ${moves.length} moves`);
    element(`${side}-lane`).replaceChildren(...moves.map(({ start, end, label }) => {
      const to = end === null ? recording.duration : end;
      const node = make("i", { title: `${side} arm, ${start.toFixed(1)} to ${to.toFixed(1)} s: ${label}` });
      Object.assign(node.style, { left: share(start), width: share(to - start) });
      const phases = recording.grippers[side];
      if (phases) node.dataset.mood = current(phases, (start + to) / 2)[2];
      return node;
    }));
  }
}

// Thin ticks where a stage begins, unless lanes show that, and buttons where something is grasped,
// released or missed; those of the right arm below its lane.
function showMarks() {
  element("marks").replaceChildren();
  const put = (node, time) => {
    node.style.left = `${100 * time / (recording.duration || 1)}%`;
    element("marks").append(node);
  };
  if (!lanes().length) for (const [time] of recording.captions.slice(1)) put(make("i"), time);
  for (const [time, kind, text, side] of recording.marks) {
    const button = make("button", { type: "button", className: kind, title: text, textContent: kind });
    if (lanes().length && side) button.dataset.side = side;
    button.setAttribute("aria-label", `${kind} at ${time.toFixed(1)} s: ${text}`);
    button.addEventListener("click", () => replay.jump(time));
    put(button, time);
  }
  labelMarks();
}

// Words where there is room for them all, or else ticks.
function labelMarks() {
  const marks = element("marks");
  marks.classList.remove("dense");
  const isDense = (buttons) => {
    const boxes = buttons.map((button) => button.getBoundingClientRect());
    boxes.sort((one, other) => one.left - other.left);
    return boxes.some(({ left }, i) => i > 0 && left < boxes[i - 1].right);
  };
  const buttons = [...marks.querySelectorAll("button")];
  const below = (button) => button.dataset.side === "right";
  marks.classList.toggle("dense", isDense(buttons.filter(below)) || isDense(buttons.filter((button) => !below(button))));
}

// The time line's tooltip names the stage under the cursor.
function nameStage({ offsetX }) {
  const thumb = parseFloat(getComputedStyle(element("marks")).left);
  const share = (offsetX - thumb) / (element("scrub").clientWidth - 2 * thumb);
  const time = Math.min(Math.max(share, 0), 1) * replay.duration;
  const text = recording.captions.length ? current(recording.captions, time)[1] : "";
  element("scrub").title = `${time.toFixed(1)} s${text && `: ${text}`}`;
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
  const elapsed = Math.min((now - last) / 1000, MAX_FRAME_S);
  last = now;
  if (replay.playing) advance(elapsed);
  requestAnimationFrame(tick);
}

// What the camera is to have in view: whatever moves, wherever it comes.
function actionPoints() {
  const animation = recording.commands.find(({ type }) => type === "set_animation");
  const paths = animation.animations.map(({ path }) => `/${path.join("/")}`).filter((path) => path.startsWith("/bodies/"));
  const points = [];
  for (let k = 0; k <= FIT_SAMPLES; k++) {
    viewer.animator.seek((k / FIT_SAMPLES) * recording.duration);
    points.push(...pointsNow(recording.sides, paths));
  }
  return points.length ? points : around([0.6, 0, 0.1], 0.6);
}

function clearScene() {
  for (const name of ["robot", "bodies", "path", "ink", "goals", "frames", "ghost", "nearest"]) {
    if (nodeAt(name)) viewer.handle_command({ type: "delete", path: `/${name}` });
  }
}

// Make the page a player of this recording.
function startReplay(content, { time = 0 } = {}) {
  recording = content;
  document.body.dataset.mode = "replay";
  clearScene();
  draw(recording.commands, recording.geometries);
  viewer.animator.play(); // binds the tracks to the nodes; without it they cannot be moved
  viewer.animator.pause();
  lines = [...recording.paths.map(line), ...recording.ink.map(inkLine)];
  replay.duration = recording.duration;
  element("scrub").max = replay.duration;
  loadRecorded(recording);
  for (const side of ["left", "right"]) if (!recording.grippers[side]) write(element(`${side}-gripper`), "");
  showLayers(recording.layers);
  listArms();
  listBounds();
  document.body.classList.toggle("inked", recording.ink.length > 0);
  listStages(recording.captions);
  listWaypoints();
  showLanes();
  showMarks();
  view.points = actionPoints();
  view.isMirrored = recording.sides.join() === "right";
  element("speed").value = String(replay.speed);
  replay.seek(time);
  drawPanel();
  viewer.render();
  document.body.classList.add("ready");
  refit();
  element("scrub").addEventListener("pointermove", nameStage);
  new ResizeObserver(labelMarks).observe(element("marks"));
  replay.ready = true;
  last = performance.now();
  requestAnimationFrame(tick);
}
