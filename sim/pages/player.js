// Plays the recording embedded in this page. Time is kept here, not by Meshcat's animator, whose
// slider does nothing before it has played once and which forgets its place at the end.
const PAUSE_BEFORE_LOOP_S = 1.5;
const STEP_S = 0.1;
const LONGEST_FRAME_S = 0.5; // a tab that slept goes on where it was

const element = (id) => document.getElementById(id);
const viewer = createViewer();

// The recording is msgpack; Meshcat's decoder is reached by letting a copy of the viewer decode it
// and keep the result instead of drawing it.
function decode(base64) {
  let decoded;
  const reader = Object.create(viewer);
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

const recording = decode(element("data").textContent);
draw(recording.commands, recording.geometries);
viewer.animator.play(); // binds the tracks to the nodes; without it they cannot be moved
viewer.animator.pause();

const replay = { ready: false, time: 0, duration: recording.duration, playing: false, speed: 1 };

replay.seek = (time) => {
  replay.time = Math.min(Math.max(time, 0), replay.duration);
  viewer.animator.seek(replay.time);
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

function showTime() {
  element("scrub").value = replay.time;
  element("time").textContent = `${replay.time.toFixed(1)} / ${replay.duration.toFixed(1)} s`;
  element("play").textContent = replay.playing ? "Pause" : "Play";
  showCaption(captionAt(replay.time));
}

function captionAt(time) {
  let text = "";
  for (const [start, words] of recording.captions) {
    if (start > time + 1e-9) break;
    text = words;
  }
  return text;
}

let overtime = 0;
function advance(elapsed) {
  const next = replay.time + elapsed * replay.speed;
  overtime = next < replay.duration ? 0 : overtime + elapsed;
  if (overtime > PAUSE_BEFORE_LOOP_S) replay.seek(0);
  else if (replay.time < replay.duration) replay.seek(next);
  if (overtime > 0 && !element("loop").checked) replay.pause();
}

let last = performance.now();
function tick(now) {
  const elapsed = Math.min((now - last) / 1000, LONGEST_FRAME_S);
  last = now;
  if (replay.playing) advance(elapsed);
  requestAnimationFrame(tick);
}

const toggle = () => (replay.playing ? replay.pause() : replay.play());
element("play").addEventListener("click", toggle);
element("scrub").max = replay.duration;
element("scrub").addEventListener("input", (event) => {
  const time = Number(event.target.value); // before pausing, which puts the slider back
  replay.pause();
  replay.seek(time);
});
element("speed").addEventListener("change", (event) => { replay.speed = Number(event.target.value); });
document.addEventListener("keydown", (event) => {
  if (event.target.tagName === "SELECT" || event.ctrlKey || event.metaKey || event.altKey) return;
  const step = { ArrowLeft: -STEP_S, ArrowRight: STEP_S }[event.key];
  if (event.key === " ") toggle();
  else if (step) { replay.pause(); replay.seek(replay.time + step); }
  else return;
  event.preventDefault();
});

replay.seek(0);
replay.play();
replay.ready = true;
requestAnimationFrame(tick);
