// Buttons and keys, for a replay and for a live page alike.
const KEYS = {
  " ": () => pressPlay(),
  k: () => pressPlay(),
  ArrowLeft: () => replay.jump(replay.time - STEP_S),
  ArrowRight: () => replay.jump(replay.time + STEP_S),
  Home: () => replay.jump(0),
  End: () => replay.jump(replay.duration),
};

const VIEW_KEYS = {
  0: () => showView("fitted"),
  1: () => showView("front"),
  2: () => showView("side"),
  3: () => showView("top"),
  4: () => showView("hand"),
  "+": () => zoom(0.85),
  "-": () => zoom(1 / 0.85),
  p: () => element("panel-button").click(),
  v: () => element("view-button").click(),
  "?": () => element("help").showModal(),
  Escape: () => openViews(false),
};

const TURN_KEYS = {
  ArrowLeft: () => turn(-1, 0),
  ArrowRight: () => turn(1, 0),
  ArrowUp: () => turn(0, 1),
  ArrowDown: () => turn(0, -1),
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

function openViews(isOpen) {
  element("views").hidden = !isOpen;
  element("view-button").setAttribute("aria-expanded", isOpen);
}

function chooseSpeed() {
  const speed = Number(element("speed").value);
  if (document.body.dataset.mode === "live") tellProgram("speed", speed);
  else replay.speed = speed;
}

function listen() {
  element("play").addEventListener("click", pressPlay);
  element("scrub").addEventListener("input", (event) => replay.jump(Number(event.target.value)));
  element("speed").addEventListener("change", chooseSpeed);
  element("view-button").addEventListener("click", () => openViews(element("views").hidden));
  element("help-button").addEventListener("click", () => element("help").showModal());
  for (const button of element("views").querySelectorAll("button")) {
    button.addEventListener("click", () => showView(button.value));
  }
  document.addEventListener("pointerdown", ({ target }) => {
    if (!target.closest("#views, #view-button")) openViews(false);
  });
  document.addEventListener("keydown", pressKey);
}

// Everything but what is shown.
function startPage() {
  viewer = createViewer();
  createCamera();
  createPanel();
  listen();
}
