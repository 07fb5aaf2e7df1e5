// Buttons and keys, for a replay and for a live page alike.
const KEYS = {
  " ": () => pressPlay(),
  k: () => pressPlay(),
  ArrowLeft: () => replay.jump(replay.time - STEP_S),
  ArrowRight: () => replay.jump(replay.time + STEP_S),
  Home: () => replay.jump(0),
  End: () => replay.jump(replay.duration),
};

const OWN_SPACE = "button, select, summary, a, input:not([type=range])";

function pressPlay() {
  if (document.body.dataset.mode === "replay") replay.toggle();
  else pauseProgram();
}

// What a key does here; a control that has focus keeps its own keys.
function actionOf({ key, shiftKey, target }) {
  if (shiftKey && TURN_KEYS[key]) return target.closest("select") ? null : TURN_KEYS[key];
  if (key === " " && target.closest(OWN_SPACE)) return null;
  if (target.closest("select, dialog")) return null;
  if (["Home", "End"].includes(key) && target.closest("#panel")) return null; // it scrolls
  if (document.body.dataset.mode === "replay" || key === " " || key === "k") return KEYS[key] || VIEW_KEYS[key];
  return VIEW_KEYS[key];
}

function pressKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || !viewer) return;
  const act = actionOf(event);
  if (!act) return;
  act();
  event.preventDefault();
}

function chooseSpeed() {
  const speed = Number(element("speed").value);
  if (document.body.dataset.mode === "live") sendRequest("speed", speed);
  else replay.speed = speed;
}

function listen() {
  element("play").addEventListener("click", pressPlay);
  element("scrub").addEventListener("input", (event) => replay.jump(Number(event.target.value)));
  element("speed").addEventListener("change", chooseSpeed);
  listenToView();
  document.addEventListener("keydown", pressKey);
}

// Everything but what is shown.
function startPage() {
  viewer = createViewer();
  createCamera();
  createPanel();
  listen();
}
