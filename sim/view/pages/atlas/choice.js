// What is chosen, by controls, keys and clicks: an arm, rotations, a height, a cell.
const FIRST_POINT = [0.7, 0.3, 0.1]; // in front of the left shoulder
const CLICK_PX = 5;
const MOVE_MS = 500;
const MAX_FITTED = 1500;
const WIDE_PX = 1000;
const HIGH_PX = 640;
const EXTENTS = ["slice", "below", "whole"];
const ARM_WORDS = { left: "left arm", right: "right arm", either: "either arm", both: "both arms" };

const choice = { arm: "either", direction: ANY, roll: ANY, extent: "below", cell: [0, 0, 0], pinned: null, rotation: null, witness: null };
const posture = { shown: {}, frame: 0 };

// The map's colours and the cells again, then the cell.
function chooseMap(change = {}) {
  Object.assign(choice, change);
  choice.rotations = rotationsOf(choice.direction, choice.roll);
  drawn.summary = summarise(choice.arm, choice.rotations);
  const isOne = isOneRotation();
  const ticks = isOne ? [0, 0.5, 1].map((share) => `${number(share * atlas.topMargin, 2)}${share === 1 ? " rad or more" : ""}`) : ["0", "25", "50", "75", "100 %"];
  showLegend(isOne ? "Margin to the nearest joint limit" : `Share of ${choice.rotations.length} rotations that are reached`, ticks);
  chooseCell();
}

function chooseCell(change = {}) {
  if (change.cell) Object.assign(choice, { pinned: null });
  Object.assign(choice, change);
  const place = placeOf(choice.cell);
  choice.rotation = rotationToShow(place);
  choice.witness = choice.rotation === null ? null : bestWitness(choice.rotation, place);
  drawCells(choice);
  drawChosen(choice.cell, choice.rotation);
  drawChart(choice);
  showControls();
  showShares(choice.rotations, place);
  const { unreachable, undecided, rotations } = drawn.summary;
  showWords({ rotation: choice.rotation, witness: choice.witness, counts: { unreachable: unreachable[place], undecided: undecided[place], total: rotations } });
  poseArms(choice.witness && choice.witness.isMet ? choice.witness : null);
}

// The rotation that was asked for, or that of the chosen ones with the greatest margin.
function rotationToShow(place) {
  if (choice.pinned !== null) return choice.pinned;
  if (choice.rotations.length === 1) return choice.rotations[0];
  const level = (rotation) => levelAt(choice.arm, rotation, place);
  const best = choice.rotations.reduce((one, other) => (level(other) > level(one) ? other : one));
  return level(best) >= FIRST_LEVEL ? best : null;
}

// Of the arms that reach the pose, that with the greatest margin.
function bestWitness(rotation, place) {
  if (levelAt(choice.arm, rotation, place) < FIRST_LEVEL) return null;
  const arms = armsOf(choice.arm).filter((arm) => levelOf(arm, rotation, place) >= FIRST_LEVEL);
  const best = arms.reduce((one, other) => (levelOf(other, rotation, place) > levelOf(one, rotation, place) ? other : one));
  return witnessOf(atlas.map.arms[best], rotation, place);
}

function poseArms(witness) {
  const goal = {};
  for (const [side, arm] of Object.entries(atlas.arms)) goal[side] = witness && witness.side === side ? witness.q : arm.neutral;
  view.side = witness ? witness.side : view.side;
  moveArms(goal);
}

// Turn the joints there, at once where motion is unwanted.
function moveArms(goal) {
  cancelAnimationFrame(posture.frame);
  const from = { ...posture.shown };
  const begun = performance.now();
  const step = (now) => {
    const share = prefersStill.matches ? 1 : Math.min(Math.max(now - begun, 0) / MOVE_MS, 1);
    const eased = share * share * (3 - 2 * share);
    for (const [side, q] of Object.entries(goal)) placeJoints(side, share === 1 ? q : q.map((angle, joint) => from[side][joint] + eased * (angle - from[side][joint])));
    posture.isMoving = share < 1;
    if (share < 1) posture.frame = requestAnimationFrame(step);
  };
  step(begun);
}

function placeJoints(side, q) {
  const { paths, axes } = atlas.arms[side];
  posture.shown[side] = q;
  q.forEach((angle, joint) => {
    const value = [...axes[joint].map((x) => x * Math.sin(angle / 2)), Math.cos(angle / 2)];
    viewer.handle_command({ type: "set_property", path: paths[joint], property: "quaternion", value });
  });
}

// The next rotation of the chosen ones that is reached here.
function turnTo(step) {
  const place = placeOf(choice.cell);
  const reached = choice.rotations.filter((rotation) => levelAt(choice.arm, rotation, place) >= FIRST_LEVEL);
  if (!reached.length) return;
  const at = reached.indexOf(choice.rotation);
  chooseCell({ pinned: reached[at < 0 ? 0 : (at + step + reached.length) % reached.length] });
}

function goTo(axis, index) {
  const cell = [...choice.cell];
  cell[axis] = Math.min(Math.max(index, 0), atlas.map.shape[axis] - 1);
  chooseCell({ cell });
}

const SLIDERS = ["x", "y", "height"];

function showControls() {
  SLIDERS.forEach((id, axis) => {
    const text = metres(pointOf(choice.cell)[axis]);
    element(id).value = choice.cell[axis];
    element(id).setAttribute("aria-valuetext", text);
    write(element(`${id}-value`), axis === 2 ? `z ${text}` : text);
  });
  for (const radio of document.querySelectorAll("input[type=radio]")) radio.checked = radio.value === choice[radio.name];
  element("direction").value = choice.direction;
  element("roll").value = choice.roll;
  const reached = atlas.map.rotations.filter((_, rotation) => levelAt(choice.arm, rotation, placeOf(choice.cell)) >= FIRST_LEVEL).length;
  write(element("chart-note"), `${reached} of ${rotationCount()} rotations reached here; a row is where the tool points, a column a roll, its colour the margin up to ${number(atlas.topMargin, 1)} rad.`);
}

function createControls() {
  const { map } = atlas;
  const arms = map.arms.length > 1 ? ["left", "right", "either", "both"] : map.arms;
  element("arms").append(...arms.map((arm) => make("label", {}, make("input", { type: "radio", name: "arm", value: arm }), ARM_WORDS[arm])));
  const options = (texts) => [["any", ANY], ...texts.map((text, index) => [text, index])].map(([textContent, value]) => make("option", { value, textContent }));
  element("direction").append(...options(map.directions));
  element("roll").append(...options(map.rolls.map(degrees)));
  element("roll").closest("label").hidden = map.rolls.length < 2;
  SLIDERS.forEach((id, axis) => {
    element(id).max = map.shape[axis] - 1;
    element(id).addEventListener("input", () => goTo(axis, Number(element(id).value)));
  });
  const has = (level) => map.levels.includes(level);
  element("undecided-key").hidden = !has(UNDECIDED);
  element("unknown-key").hidden = !has(NOT_COMPUTED);
  const whole = `The map has ${map.cells.toLocaleString("en")} cells: ${map.rotations.length} rotations of ${map.arms.length === 1 ? "one arm's tool" : "each arm's tool"} at positions ${number(1000 * map.stepOfMap, 0)} mm apart.`;
  write(element("source"), map.every > 1 ? `${whole} This page has one of ${map.every} positions along each axis, since more do not fit.` : whole);
}

const KEYS = {
  PageUp: () => goTo(2, choice.cell[2] + 1),
  PageDown: () => goTo(2, choice.cell[2] - 1),
  ArrowUp: () => goTo(0, choice.cell[0] + 1),
  ArrowDown: () => goTo(0, choice.cell[0] - 1),
  ArrowLeft: () => goTo(1, choice.cell[1] + 1),
  ArrowRight: () => goTo(1, choice.cell[1] - 1),
  l: () => chooseArm("left"),
  r: () => chooseArm("right"),
  e: () => chooseArm("either"),
  b: () => chooseArm("both"),
  s: () => chooseExtent(EXTENTS[(EXTENTS.indexOf(choice.extent) + 1) % EXTENTS.length]),
  n: () => turnTo(1),
};

function chooseArm(arm) {
  if (document.querySelector(`#arms input[value=${arm}]`)) chooseMap({ arm, pinned: null });
}

function chooseExtent(extent) {
  chooseCell({ extent });
  fitCamera();
}

function actionOf({ key, shiftKey, target }) {
  if (target.closest("select, dialog")) return null;
  if (shiftKey && TURN_KEYS[key]) return TURN_KEYS[key];
  if (target.closest("input") && /^(Arrow|Page|Home|End)/.test(key)) return null; // the control's own
  if (target.closest("#panel") && /^(Page|Arrow)/.test(key)) return null; // it scrolls
  return KEYS[key] || VIEW_KEYS[key];
}

function pressKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || !atlas) return;
  const act = actionOf(event);
  if (!act) return;
  act();
  event.preventDefault();
}

function openPanel(isOpen) {
  element("panel").hidden = !isOpen;
  element("panel-button").setAttribute("aria-expanded", isOpen);
  if (isOpen) drawChart(choice);
  refit({ flies: true });
}

function listen() {
  listenToView();
  document.addEventListener("keydown", pressKey);
  element("panel-button").addEventListener("click", () => openPanel(element("panel").hidden));
  element("arms").addEventListener("change", ({ target }) => chooseArm(target.value));
  element("extents").addEventListener("change", ({ target }) => chooseExtent(target.value));
  for (const id of ["direction", "roll"]) element(id).addEventListener("change", ({ target }) => chooseMap({ [id]: Number(target.value), pinned: null }));
  element("previous").addEventListener("click", () => turnTo(-1));
  element("next").addEventListener("click", () => turnTo(1));
  element("best").addEventListener("click", () => chooseCell({ pinned: null }));
  element("chart").addEventListener("click", (event) => {
    const rotation = rotationUnder(event);
    if (rotation !== null) chooseCell({ pinned: rotation });
  });
  new ResizeObserver(() => drawChart(choice)).observe(element("chart"));
  prefersDark.addEventListener("change", () => { paintStage(viewer); chooseCell(); });
  listenToClicks();
}

function listenToClicks() {
  let pressed = null;
  element("view").addEventListener("pointerdown", ({ clientX, clientY }) => { pressed = [clientX, clientY]; }, { capture: true });
  element("view").addEventListener("click", ({ clientX, clientY }) => {
    if (!pressed || Math.hypot(clientX - pressed[0], clientY - pressed[1]) > CLICK_PX) return;
    const place = placeUnder(clientX, clientY);
    if (place !== null) chooseCell({ cell: indicesOf(place) });
  });
}

// What the camera is to have in view: what is drawn of the map, and the robot's head.
function fitCamera() {
  const every = Math.ceil(drawn.boxes.length / MAX_FITTED);
  const reached = drawn.boxes.filter(({ place }, i) => i % every === 0 && drawn.summary.reached[place]);
  viewer.scene.updateMatrixWorld();
  view.points = [...reached.map(({ centre }) => centre), ...headPoints()];
  refit({ flies: true });
}

VIEWS.fitted = [2.3, 1.6, 1.5]; // from higher than a replay's, so that the plane is seen

startWith(async () => {
  viewer = createViewer();
  viewer.renderer.domElement.setAttribute("aria-label", "The robot with the map around it, drawn in 3D; the card says what is known of the chosen cell");
  createCamera();
  atlas = await decode(element("data").textContent);
  atlas.topMargin = topMargin();
  indexWitnesses();
  draw(atlas.commands, atlas.geometries);
  for (const [side, arm] of Object.entries(atlas.arms)) posture.shown[side] = arm.neutral;
  createCells();
  createControls();
  listen();
  const { low, step, shape, arms } = atlas.map;
  const cell = FIRST_POINT.map((value, axis) => Math.min(Math.max(Math.round((value - low[axis]) / step), 0), shape[axis] - 1));
  chooseMap({ arm: arms.length > 1 ? "either" : arms[0], cell });
  document.body.classList.add("ready");
  openPanel(window.innerWidth >= WIDE_PX && window.innerHeight >= HIGH_PX);
  fitCamera();
  showView("fitted", { flies: false });
  atlas.ready = true;
});
